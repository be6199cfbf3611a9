//! Motions for a run that is too long for a list in memory: planned or read on a thread of their own, a few thousand
//! ahead of the PLC.

use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::{self, JoinHandle};
use std::vec;

use anyhow::{Context, anyhow};
use planning::{Application, MotionLines, ToStart};
use plc_node::MotionSource;
use protocol::image::{Digest, Motion, Sum};
use setup::Setup;

/// Motions that are handed over at once.
const CHUNK: usize = 4096;

/// Chunks that may wait for the PLC: with the one that it takes from and the one that is being filled, all that there
/// is in memory of the list.
const CHUNKS_AHEAD: usize = 2;

/// Where the motions come from.
#[derive(Debug)]
pub enum Origin {
    /// An application, planned for a setup again and again.
    Application(Box<(Application, Setup)>),
    /// A motion list.
    List(PathBuf),
}

impl Origin {
    /// What messages call it.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Application(it) => it.0.name.clone(),
            Self::List(path) => path.display().to_string(),
        }
    }

    /// How many of the first `most` motions there are. It looks at each one that is not a repetition of others, so that
    /// a list is refused before anything moves.
    ///
    /// # Errors
    ///
    /// A motion cannot be planned or read, or there is none.
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

    /// How the arm gets to where the motions begin. A list begins wherever the arm stands.
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

    /// Writes the first `most` motions as a list.
    ///
    /// # Errors
    ///
    /// A motion cannot be planned or read, or the file cannot be written.
    pub fn write(&self, most: u32, path: &Path) -> anyhow::Result<Sum> {
        let cannot = || format!("cannot write {}", path.display());
        let mut file = BufWriter::new(File::create(path).with_context(cannot)?);
        planning::write_header(&mut file).with_context(cannot)?;
        let (mut digest, mut written) = (Digest::default(), Ok(()));
        self.each(most, |motion| {
            digest.add(&motion);
            written = planning::write_motion(&mut file, &motion);
            if written.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        })?;
        written.and_then(|()| file.flush()).with_context(cannot)?;
        Ok(digest.sum())
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
                let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
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

/// The thread that makes the motions.
#[derive(Debug)]
pub struct Supply(JoinHandle<anyhow::Result<Sum>>);

impl Supply {
    /// Starts to make `total` motions; they come out of the source.
    #[must_use]
    pub fn start(origin: Origin, total: u32) -> (Self, Supplied) {
        let (sender, chunks) = sync_channel(CHUNKS_AHEAD);
        let thread = thread::spawn(move || {
            let mut digest = Digest::default();
            let mut chunk = Vec::with_capacity(CHUNK);
            origin.each(total, |motion| {
                digest.add(&motion);
                chunk.push(motion);
                if chunk.len() < CHUNK {
                    return ControlFlow::Continue(());
                }
                // Who does not want more motions has ended.
                match sender.send(std::mem::replace(&mut chunk, Vec::with_capacity(CHUNK))) {
                    Ok(()) => ControlFlow::Continue(()),
                    Err(_) => ControlFlow::Break(()),
                }
            })?;
            let _ = sender.send(chunk);
            Ok(digest.sum())
        });
        (Self(thread), Supplied { total, next: 0, chunks, chunk: Vec::new().into_iter() })
    }

    /// What the whole list was, once the PLC has it or does not want it any more.
    ///
    /// # Errors
    ///
    /// A motion could not be planned or read: the source ended before it.
    pub fn finish(self) -> anyhow::Result<Sum> {
        self.0.join().map_err(|_| anyhow!("the thread that makes the motions broke off"))?
    }
}

/// The motions as the PLC takes them.
///
/// It waits for the thread that makes them, which a scan on a real clock could not; waiting takes no virtual time.
#[derive(Debug)]
pub struct Supplied {
    total: u32,
    next: u32,
    chunks: Receiver<Vec<Motion>>,
    chunk: vec::IntoIter<Motion>,
}

impl MotionSource for Supplied {
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
