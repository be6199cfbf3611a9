//! The pages that are open. Each has a queue of its own; one that does not take its news is dropped, and gets the whole
//! when it asks again.

use std::sync::Arc;

use tokio::sync::mpsc;

use super::state::Part;

/// Pages at once.
const PAGES: usize = 8;

/// Parts that may wait for a page: some seconds of a run.
const WAITING: usize = 128;

/// The state, and the pages that follow it.
#[derive(Debug, Default)]
pub(super) struct Hub {
    state: Part,
    pages: Vec<mpsc::Sender<Arc<str>>>,
}

impl Hub {
    /// Adds a part to the state and sends it to every page.
    pub(super) fn publish(&mut self, part: Part) {
        if part.is_empty() {
            return;
        }
        if !self.pages.is_empty() {
            let text = text(&part);
            self.pages.retain(|page| page.try_send(Arc::clone(&text)).is_ok());
        }
        self.state.add(part);
    }

    /// Opens a page: its first text is the whole state, the others are the parts from then on. `None` if there are too many.
    pub(super) fn open(&mut self) -> Option<mpsc::Receiver<Arc<str>>> {
        self.pages.retain(|page| !page.is_closed());
        if self.pages.len() >= PAGES {
            return None;
        }
        let (sender, receiver) = mpsc::channel(WAITING);
        sender.try_send(text(&self.state.whole())).ok()?;
        self.pages.push(sender);
        Some(receiver)
    }

    /// Ends the queues of all pages, after what waits in them.
    pub(super) fn close(&mut self) {
        self.pages.clear();
    }
}

fn text(part: &Part) -> Arc<str> {
    serde_json::to_string(part).unwrap_or_default().into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::state::Line;

    fn said(text: &str) -> Part {
        let line = Line { at: String::new(), is_problem: false, text: text.to_owned() };
        Part { log: [line].into(), ..Part::default() }
    }

    #[test]
    fn a_page_that_hangs_is_dropped_and_the_others_get_everything() {
        let mut hub = Hub::default();
        let (mut hanging, mut good) = (hub.open().unwrap(), hub.open().unwrap());
        let mut seen = 0;
        for index in 0..1_000 {
            hub.publish(said(&index.to_string()));
            while good.try_recv().is_ok() {
                seen += 1;
            }
        }
        assert_eq!((seen, hub.pages.len()), (1_001, 1));
        let mut left = 0;
        while hanging.try_recv().is_ok() {
            left += 1;
        }
        assert_eq!(left, WAITING, "what waited is bounded");
        assert!(hanging.is_closed());
    }

    #[test]
    fn a_page_that_opens_later_gets_the_whole_first_and_too_many_get_nothing() {
        let mut hub = Hub::default();
        hub.publish(said("before"));
        let mut pages: Vec<_> = (0..PAGES).map(|_| hub.open().unwrap()).collect();
        let first = pages[0].try_recv().unwrap();
        assert!(first.contains("\"is_whole\":true") && first.contains("before"), "{first}");
        assert!(hub.open().is_none());
        pages.pop();
        assert!(hub.open().is_some(), "a page that was closed makes room");
    }
}
