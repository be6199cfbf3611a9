//! The connection of a node to a station, as its supervisor knows it.

use crate::Waiting;
use crate::message::Message;

/// The connection to a station, as a new controller has to know it.
#[derive(Default)]
pub(crate) struct Link {
    pub(crate) is_up: bool,
    /// Why it is down, as text.
    pub(crate) last_down: Option<String>,
    /// The last wait that was reported and has not ended.
    pub(crate) waiting: Option<Waiting>,
    /// Identity that the device at the other end reports.
    pub(crate) identity: Option<String>,
    /// What is remarkable about the connection.
    pub(crate) remark: Option<String>,
}

impl Link {
    /// Takes what is remarkable now, nothing being an empty text. Returns what is to be reported: a new remark, or the end of the
    /// last one. The same remark again is not reported.
    pub(crate) fn take_remark(&mut self, text: &str) -> Option<String> {
        let text = Some(text).filter(|text| !text.is_empty());
        if self.remark.as_deref() == text {
            return None;
        }
        let former = std::mem::replace(&mut self.remark, text.map(str::to_owned));
        self.remark.clone().or_else(|| former.map(|former| format!("no longer so: {former}")))
    }

    /// Returns the message about a wait. A node that waits for its connection gives the last reason of the bus.
    pub(crate) fn waiting_message<M>(&self, waiting: &Waiting) -> Message<M> {
        let Waiting { seconds, for_what, is_for_connection, is_owed } = waiting;
        let reason = match &self.last_down {
            Some(down) if *is_for_connection => format!("the connection: {down}"),
            _ => for_what.clone(),
        };
        Message::Waiting { seconds: *seconds, reason, is_owed: *is_owed }
    }
}

#[cfg(test)]
mod tests {
    use super::Link;

    #[test]
    fn a_remark_is_reported_once_and_when_it_no_longer_holds() {
        let mut link = Link::default();
        let mut reported = |text: &str| link.take_remark(text);
        assert_eq!(reported(""), None);
        assert_eq!(reported("a silent owner").as_deref(), Some("a silent owner"));
        assert_eq!(reported("a silent owner"), None);
        assert_eq!(reported("another owner").as_deref(), Some("another owner"));
        assert_eq!(reported("").as_deref(), Some("no longer so: another owner"));
        assert_eq!(reported(""), None);
    }
}
