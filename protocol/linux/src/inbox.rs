//! What the thread beside the cyclic one waits for: lines on standard input, signals, and news from the cyclic thread.

use std::collections::VecDeque;
use std::os::fd::AsFd;

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;

use crate::{Notifier, StopSignal, StopSignals};

/// Longest line that is taken from standard input, in bytes; more without an end is no command of ours.
const LINE_LIMIT: usize = 64 * 1024;

/// Something came.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Input {
    /// A line of standard input, without its end.
    Line(String),
    /// Standard input ended: whoever gives the commands is gone.
    Closed,
    /// A signal.
    Stop(StopSignal),
    /// The cyclic thread has news, or is gone.
    News,
}

/// Waits for all of it at once.
#[derive(Debug)]
pub struct Inbox {
    signals: StopSignals,
    news: Notifier,
    /// None where nobody listens to standard input, or no more.
    stdin: Option<std::io::Stdin>,
    line: Vec<u8>,
    waiting: VecDeque<Input>,
}

impl Inbox {
    /// An inbox that listens to signals, `news`, and to standard input where `commands` is set.
    #[must_use]
    pub fn new(signals: StopSignals, news: Notifier, commands: bool) -> Self {
        let stdin = commands.then(std::io::stdin);
        Self { signals, news, stdin, line: Vec::new(), waiting: VecDeque::new() }
    }

    /// Waits for the next input.
    pub fn wait(&mut self) -> std::io::Result<Input> {
        loop {
            if let Some(input) = self.waiting.pop_front() {
                return Ok(input);
            }
            self.poll()?;
        }
    }

    fn poll(&mut self) -> std::io::Result<()> {
        let [news, stop, typed] = {
            let news = PollFd::new(&self.news, PollFlags::IN);
            let stop = PollFd::new(&self.signals, PollFlags::IN);
            let stdin =
                self.stdin.as_ref().map(|stdin| PollFd::from_borrowed_fd(stdin.as_fd(), PollFlags::IN));
            let mut waits: Vec<_> = [news, stop].into_iter().chain(stdin).collect();
            match poll(&mut waits, None) {
                Ok(_) => {}
                Err(Errno::INTR) => return Ok(()),
                Err(error) => return Err(error.into()),
            }
            let ready = |index: usize| waits.get(index).is_some_and(|wait| !wait.revents().is_empty());
            [ready(0), ready(1), ready(2)]
        };
        // News that happened before a stop is told before it.
        if news {
            self.news.clear();
            self.waiting.push_back(Input::News);
        }
        if stop && let Some(signal) = self.signals.take() {
            self.waiting.push_back(Input::Stop(signal));
        }
        if typed {
            self.read_lines()?;
        }
        Ok(())
    }

    fn read_lines(&mut self) -> std::io::Result<()> {
        let Some(stdin) = &self.stdin else {
            return Ok(());
        };
        let mut bytes = [0; 4096];
        let len = match rustix::io::read(stdin.as_fd(), &mut bytes) {
            Ok(len) => len,
            Err(Errno::INTR | Errno::AGAIN) => return Ok(()),
            Err(error) => return Err(error.into()),
        };
        let read = bytes.get(..len).unwrap_or_default();
        if read.is_empty() || self.line.len() + read.len() > LINE_LIMIT {
            self.stdin = None;
            self.waiting.push_back(Input::Closed);
            return Ok(());
        }
        for byte in read {
            if *byte == b'\n' {
                let line = String::from_utf8_lossy(&self.line).into_owned();
                self.waiting.push_back(Input::Line(line));
                self.line.clear();
            } else {
                self.line.push(*byte);
            }
        }
        Ok(())
    }
}
