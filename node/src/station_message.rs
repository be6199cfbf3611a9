//! Messages of a node with several stations: each message about a station names it.
//!
//! A line of JSON has the station beside the message, as in `{"station":"left","link_down":{"reason":"..."}}`; a message that is
//! only a word has `null` then: `{"station":"left","link_up":null}`. Text begins with the name: `left: connected`. Messages about
//! the whole node, and all messages of a node with one station, are as [`Message`] has them.

use std::fmt;

use serde::de::{DeserializeOwned, IgnoredAny};
use serde::{Deserialize, Serialize};

use crate::message::Message;
use crate::output::to_stdout;

/// A message and the station that it is about.
#[derive(Clone, PartialEq, Debug)]
pub struct StationMessage<M> {
    /// Name of the station; `None` where the message is about the whole node, or where there is only one.
    pub station: Option<String>,
    /// The message.
    pub message: Message<M>,
}

/// A line of JSON with a station in it.
#[derive(Serialize)]
struct NamedLine<'a, M: Serialize> {
    station: &'a str,
    #[serde(flatten)]
    message: &'a Message<M>,
}

/// The same, read.
#[derive(Deserialize)]
struct ReadLine<M> {
    station: String,
    #[serde(flatten)]
    message: Message<M>,
}

/// Reads whether a line has a station.
#[derive(Deserialize)]
struct HasStation {
    #[serde(rename = "station")]
    _station: IgnoredAny,
}

impl<M> From<Message<M>> for StationMessage<M> {
    fn from(message: Message<M>) -> Self {
        Self { station: None, message }
    }
}

impl<M: Serialize> StationMessage<M> {
    /// Returns the message as one line of JSON, without line end.
    #[must_use]
    pub fn to_json(&self) -> String {
        match &self.station {
            None => self.message.to_json(),
            Some(station) => {
                let line = NamedLine { station, message: &self.message };
                serde_json::to_string(&line).unwrap_or_default()
            }
        }
    }
}

impl<M: DeserializeOwned> StationMessage<M> {
    /// Reads a line of JSON, with or without a station.
    ///
    /// # Errors
    ///
    /// The line is not a message.
    pub fn from_json(line: &str) -> Result<Self, serde_json::Error> {
        if serde_json::from_str::<HasStation>(line).is_ok() {
            let ReadLine { station, message } = serde_json::from_str(line)?;
            return Ok(Self { station: Some(station), message });
        }
        serde_json::from_str(line).map(|message| Self { station: None, message })
    }
}

impl<M: fmt::Display> fmt::Display for StationMessage<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(station) = &self.station {
            write!(f, "{station}: ")?;
        }
        self.message.fmt(f)
    }
}

/// Format of the messages on standard output.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Console {
    /// Text for a person.
    Text,
    /// One JSON value a line, for a program.
    Json,
}

impl Console {
    /// Prints a message on standard output.
    ///
    /// A failure is ignored: it cannot be reported, and standard input ends then, too.
    pub fn print<M: Serialize + fmt::Display>(self, message: &StationMessage<M>) {
        let line = match self {
            Self::Text => message.to_string(),
            Self::Json => message.to_json(),
        };
        let _ = to_stdout(format_args!("{line}\n"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn messages() -> [Message<String>; 6] {
        [
            Message::LinkUp,
            Message::LinkDown { reason: "no answer".to_owned() },
            Message::Waiting { seconds: 10, reason: "the robot".to_owned(), is_owed: true },
            Message::Remark { text: "slower than asked".to_owned() },
            Message::Conflict { conflict: "another station".to_owned() },
            Message::Node("ready".to_owned()),
        ]
    }

    #[test]
    fn without_a_station_a_message_is_written_as_it_always_was() {
        for message in messages() {
            let (json, text) = (message.to_json(), message.to_string());
            let of_station = StationMessage::from(message);
            assert_eq!((of_station.to_json(), of_station.to_string()), (json, text));
        }
    }

    #[test]
    fn a_station_stands_beside_its_message_in_json_and_before_it_in_text() {
        let named = messages().map(|message| StationMessage { station: Some("left".to_owned()), message });
        let json: Vec<_> = named.iter().map(StationMessage::to_json).collect();
        insta::assert_snapshot!(json.join("\n"), @r#"
        {"station":"left","link_up":null}
        {"station":"left","link_down":{"reason":"no answer"}}
        {"station":"left","waiting":{"seconds":10,"reason":"the robot","is_owed":true}}
        {"station":"left","remark":{"text":"slower than asked"}}
        {"station":"left","conflict":{"conflict":"another station"}}
        {"station":"left","node":"ready"}
        "#);
        let text: Vec<_> = named.iter().map(ToString::to_string).collect();
        assert!(text.iter().all(|line| line.starts_with("left: ")), "{text:?}");
        assert_eq!(text[0], "left: connected");
    }

    #[test]
    fn lines_with_and_without_a_station_are_read_back() {
        for message in messages() {
            for station in [None, Some("left".to_owned())] {
                let sent = StationMessage { station, message: message.clone() };
                assert_eq!(StationMessage::from_json(&sent.to_json()).unwrap(), sent);
            }
        }
        for line in ["", "7", r#"{"station":"left"}"#, r#"{"station":7,"link_up":null}"#, r#""no_such""#] {
            assert!(StationMessage::<String>::from_json(line).is_err(), "{line}");
        }
    }
}
