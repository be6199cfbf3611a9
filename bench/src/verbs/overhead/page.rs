//! A live view with one open page. The page reads every event, as a browser does, and draws nothing.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::thread::JoinHandle;

use anyhow::{Context as _, ensure};
use planning::Found;
use plc_node::ExecutionType;
use setup::Setup;

use records::feed::Feed;
use report::live::{About, AboutArms, Live, Reserved};

/// Fewest bytes that a page receives during a measurement: more than the state at the beginning.
const FEWEST: u64 = 10_000;

/// A live view and its page.
pub(super) struct Watched {
    live: Live,
    /// Reads the events to their end and returns how many bytes they had.
    page: JoinHandle<u64>,
}

impl Watched {
    /// Serves the rows in `directory` and opens a page.
    pub(super) fn start(
        setup: &Setup,
        found: &Found,
        execution_type: ExecutionType,
        directory: &Path,
    ) -> anyhow::Result<Self> {
        let about = About {
            arms: AboutArms::One(setup, &found.application),
            types: &[execution_type],
            reps: 1,
            no_rows: None,
        };
        let reserved = Reserved::open("127.0.0.1:0".parse()?)?;
        let live = Live::start(reserved, &about, Some(directory))?;
        let address = live.address();
        let mut stream = TcpStream::connect(address).context("cannot open the live view")?;
        write!(stream, "GET /events HTTP/1.1\r\nHost: {address}\r\n\r\n")
            .context("cannot ask for the events")?;
        let read = move || {
            let (mut buffer, mut bytes) = ([0; 16_384], 0);
            while let Ok(read @ 1..) = stream.read(&mut buffer) {
                bytes += read as u64;
            }
            bytes
        };
        let page = std::thread::Builder::new().name("page".to_owned()).spawn(read)?;
        // A page that receives the next repetition drops the previous one.
        live.feed().next(execution_type, 1);
        Ok(Self { live, page })
    }

    pub(super) fn feed(&self) -> Feed {
        self.live.feed()
    }

    /// Ends the view; an error if the page received too little.
    pub(super) fn end(self) -> anyhow::Result<()> {
        self.live.close(None);
        let bytes = self.page.join().unwrap_or_default();
        ensure!(
            bytes >= FEWEST,
            "the page got only {bytes} bytes, so the figures are not of a page that watches"
        );
        Ok(())
    }
}
