//! Motions for a run that is too long for a list in memory: a thread plans or reads them, a few thousand ahead of the
//! PLC.

use std::io::{BufRead as _, BufReader, BufWriter, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;
use std::vec;

use anyhow::{Context, anyhow};
use planning::{Application, MotionLines, ToStart};
use plc_node::MotionSource;
use protocol::image::{Digest, Motion, Sum};
use setup::{Setup, open_plain_file};

use records::replacement::{Durability, Replacement};

/// How long the receiver waits before the supply begins.
const FIRST_WAIT: Duration = Duration::from_micros(100);

/// Number of motions in a chunk.
const CHUNK: usize = 4096;

/// Largest number of chunks that wait for the PLC. Together with the chunk that the PLC reads and the one that is
/// being filled, they are all of the list that is in memory.
const CHUNKS_AHEAD: usize = 2;

/// Source of the motions.
#[derive(Debug)]
pub enum Origin {
    /// An application, planned for a setup and repeated.
    Application(Box<(Application, Setup)>),
    /// A motion list.
    List(PathBuf),
}

impl Origin {
    /// Returns its name in messages.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Application(it) => it.0.name.clone(),
            Self::List(path) => path.display().to_string(),
        }
    }

    /// Returns how many of the first `most` motions exist. It checks each one that is not a repetition, so that a
    /// wrong list is refused before anything moves.
    ///
    /// # Errors
    ///
    /// A motion cannot be planned or read, or there are none.
    pub fn count(&self, most: u32) -> anyhow::Result<u32> {
        let counted = match self {
            Self::Application(it) => match planning::count(&it.0, &it.1, 2)? {
                0 => 0,
                _ => most,
            },
            Self::List(_) => {
                let mut counted = 0;
                self.each(most, |_| {
                    counted += 1;
                    ControlFlow::Continue(())
                })?;
                counted
            }
        };
        if counted == 0 { Err(anyhow!("{} has no motions", self.name())) } else { Ok(counted) }
    }

    /// Returns how the arm gets to the start of the motions. A list starts wherever the arm is.
    ///
    /// # Errors
    ///
    /// The start cannot be planned.
    pub fn to_start(&self) -> anyhow::Result<ToStart<Motion>> {
        Ok(match self {
            Self::Application(it) => planning::to_start(&it.0, &it.1)?,
            Self::List(_) => ToStart::default(),
        })
    }

    /// Writes the first `most` motions as a list, unless one of them cannot be planned or read: then a file of that name stays
    /// as it is.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn write(&self, most: u32, path: &Path) -> anyhow::Result<anyhow::Result<Sum>> {
        let cannot = || format!("cannot write {}", path.display());
        let mut replacement = Replacement::create(path)?;
        let mut file = BufWriter::new(replacement.file());
        planning::write_header(&mut file).with_context(cannot)?;
        let (mut digest, mut written) = (Digest::default(), Ok(()));
        let all = self.each(most, |motion| {
            digest.add(&motion);
            written = planning::write_motion(&mut file, &motion);
            if written.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        });
        written.and_then(|()| file.flush()).with_context(cannot)?;
        drop(file);
        if let Err(refused) = all {
            return Ok(Err(refused));
        }
        replacement.finish(Durability::Written)?;
        Ok(Ok(digest.sum()))
    }

    /// Calls `take` with each of the first `most` motions, until it has enough.
    fn each(&self, most: u32, mut take: impl FnMut(Motion) -> ControlFlow<()>) -> anyhow::Result<()> {
        let most = most as usize;
        match self {
            Self::Application(it) => {
                let (application, setup) = &**it;
                for streamed in planning::stream(application, setup, u64::MAX).take(most) {
                    if take(streamed?.motion).is_break() {
                        break;
                    }
                }
            }
            Self::List(path) => {
                let file =
                    open_plain_file(path).with_context(|| format!("cannot read {}", path.display()))?;
                let lines = MotionLines::new(BufReader::new(file), path.display().to_string());
                for motion in lines.take(most) {
                    if take(motion?).is_break() {
                        break;
                    }
                }
            }
        }
        Ok(())
    }
}

/// Returns the line of a list, counted from 1, in which a motion stands, counted from 0; `None` if there is none.
pub(super) fn line_of(path: &Path, motion: u32) -> Option<usize> {
    let lines = BufReader::new(open_plain_file(path).ok()?).lines();
    let is_content = |line: &str| !line.trim().is_empty() && !line.trim_start().starts_with('#');
    let content = lines.map_while(Result::ok).enumerate().filter(|(_, line)| is_content(line));
    // The first one names the columns.
    content.map(|(index, _)| index + 1).nth(motion as usize + 1)
}

/// The thread that supplies the motions.
#[derive(Debug)]
pub struct SupplyThread(JoinHandle<anyhow::Result<Sum>>);

impl SupplyThread {
    /// Starts to supply `total` motions through the returned source.
    #[must_use]
    pub fn start(origin: Origin, total: u32) -> (Self, SuppliedMotions) {
        let (sender, chunks) = sync_channel(CHUNKS_AHEAD);
        // A thread that waits for the first time allocates what it is woken by. Nothing can come yet, so it does that here and not
        // in the run, where it waits only if the supply is late.
        let _: Result<Vec<Motion>, _> = chunks.recv_timeout(FIRST_WAIT);
        let thread = thread::spawn(move || {
            let mut digest = Digest::default();
            let mut chunk = Vec::with_capacity(CHUNK);
            origin.each(total, |motion| {
                digest.add(&motion);
                chunk.push(motion);
                if chunk.len() < CHUNK {
                    return ControlFlow::Continue(());
                }
                // The receiver has ended and needs no more motions.
                match sender.send(std::mem::replace(&mut chunk, Vec::with_capacity(CHUNK))) {
                    Ok(()) => ControlFlow::Continue(()),
                    Err(_) => ControlFlow::Break(()),
                }
            })?;
            let _ = sender.send(chunk);
            Ok(digest.sum())
        });
        (Self(thread), SuppliedMotions { total, next: 0, chunks, chunk: Vec::new().into_iter() })
    }

    /// Returns the digest of the whole list, once the PLC has all of it or needs no more.
    ///
    /// # Errors
    ///
    /// A motion could not be planned or read: the source ended before it.
    pub fn finish(self) -> anyhow::Result<Sum> {
        self.0.join().map_err(|_| anyhow!("the thread that makes the motions broke off"))?
    }
}

/// The motions, as the PLC takes them.
///
/// It waits for the supplying thread, which a scan in real time could not do; waiting takes no virtual time.
#[derive(Debug)]
pub struct SuppliedMotions {
    total: u32,
    next: u32,
    chunks: Receiver<Vec<Motion>>,
    chunk: vec::IntoIter<Motion>,
}

impl MotionSource for SuppliedMotions {
    fn total(&self) -> u32 {
        self.total
    }

    fn get(&mut self, index: u32) -> Option<Motion> {
        if index != self.next {
            return None;
        }
        if self.chunk.len() == 0 {
            self.chunk = self.chunks.recv().ok()?.into_iter();
        }
        self.next += 1;
        self.chunk.next()
    }
}
