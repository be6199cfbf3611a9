//! Connections of browsers. Their number is limited, and a silent connection is closed.

use std::future::Future as _;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::serve::Listener;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep, sleep};

/// Connections at once: a browser opens several for a page.
const CONNECTIONS: usize = 32;

/// Longest time without a byte on a connection. An open page receives something more often, so a connection that reaches
/// this time hangs; what waits for it is dropped.
const LONGEST_SILENCE: Duration = Duration::from_secs(20);

/// Longest time from the first byte of a request to the first byte of its answer: a client that sends a request byte by
/// byte would hold its connection for ever.
const LONGEST_REQUEST: Duration = Duration::from_secs(10);

/// Pause after a connection that could not be accepted, for example for want of file numbers.
const AFTER_ERROR: Duration = Duration::from_millis(200);

/// Accepts as many connections as are allowed; others wait in the kernel.
#[derive(Debug)]
pub(super) struct LimitedListener {
    listener: TcpListener,
    room: Arc<Semaphore>,
}

impl LimitedListener {
    pub(super) fn new(listener: TcpListener) -> Self {
        Self { listener, room: Arc::new(Semaphore::new(CONNECTIONS)) }
    }
}

impl Listener for LimitedListener {
    type Io = TimedStream<TcpStream>;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Self::Io, SocketAddr) {
        let room = Arc::clone(&self.room).acquire_owned().await.ok();
        loop {
            match self.listener.accept().await {
                Ok((stream, address)) => return (TimedStream::new(stream, room), address),
                Err(_) => sleep(AFTER_ERROR).await,
            }
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// A stream that fails after [`LONGEST_SILENCE`] without a byte, and [`LONGEST_REQUEST`] after a request began that has no
/// answer.
#[derive(Debug)]
pub(super) struct TimedStream<S> {
    stream: S,
    /// When the request that is being received has to be whole.
    request_end: Option<Instant>,
    end: Pin<Box<Sleep>>,
    _room: Option<OwnedSemaphorePermit>,
}

impl<S> TimedStream<S> {
    fn new(stream: S, room: Option<OwnedSemaphorePermit>) -> Self {
        Self { stream, request_end: None, end: Box::pin(sleep(LONGEST_SILENCE)), _room: room }
    }

    /// Returns the result of the stream, or an error if it has waited for too long.
    fn or_timed_out<T>(
        &mut self,
        context: &mut Context<'_>,
        done: Poll<io::Result<T>>,
    ) -> Poll<io::Result<T>> {
        let now = Instant::now();
        if self.request_end.is_some_and(|end| end <= now) {
            return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
        }
        if done.is_ready() {
            let silent = now + LONGEST_SILENCE;
            self.end.as_mut().reset(self.request_end.map_or(silent, |end| end.min(silent)));
            return done;
        }
        self.end.as_mut().poll(context).map(|()| Err(io::ErrorKind::TimedOut.into()))
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for TimedStream<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let done = Pin::new(&mut self.stream).poll_read(context, buffer);
        if buffer.filled().len() > before {
            self.request_end.get_or_insert(Instant::now() + LONGEST_REQUEST);
        }
        self.or_timed_out(context, done)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for TimedStream<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let done = Pin::new(&mut self.stream).poll_write(context, bytes);
        if matches!(done, Poll::Ready(Ok(1..))) {
            self.request_end = None;
        }
        self.or_timed_out(context, done)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

    fn in_virtual_time(test: impl Future<Output = ()>) {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build();
        runtime.unwrap().block_on(test);
    }

    #[test]
    fn a_browser_that_takes_nothing_loses_its_connection() {
        in_virtual_time(async {
            let (_hanging, ours) = tokio::io::duplex(16);
            let mut ours = TimedStream::new(ours, None);
            let began = Instant::now();
            let error = ours.write_all(&[0; 64]).await.unwrap_err();
            assert_eq!((error.kind(), began.elapsed().as_secs()), (io::ErrorKind::TimedOut, 20));
        });
    }

    #[test]
    fn a_request_that_arrives_byte_by_byte_loses_its_connection_after_ten_seconds_in_all() {
        in_virtual_time(async {
            let (mut slow, ours) = tokio::io::duplex(16);
            let mut ours = TimedStream::new(ours, None);
            let began = Instant::now();
            tokio::spawn(async move {
                while slow.write_u8(b'x').await.is_ok() {
                    sleep(LONGEST_REQUEST / 7).await;
                }
            });
            let error = loop {
                if let Err(error) = ours.read_u8().await {
                    break error;
                }
            };
            assert_eq!((error.kind(), began.elapsed().as_secs()), (io::ErrorKind::TimedOut, 10));
        });
    }

    #[test]
    fn a_connection_lasts_while_anything_passes() {
        in_virtual_time(async {
            let (mut browser, ours) = tokio::io::duplex(16);
            let mut ours = TimedStream::new(ours, None);
            for _ in 0..5 {
                sleep(LONGEST_SILENCE / 2).await;
                ours.write_all(&[7]).await.unwrap();
                assert_eq!(browser.read_u8().await.unwrap(), 7);
            }
            let error = ours.read_u8().await.unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::TimedOut, "nothing came, and nothing went");
        });
    }
}
