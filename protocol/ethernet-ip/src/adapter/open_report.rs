//! The last request for a cyclic connection, and the answer to it: who finds no connection can read here what was asked for.

use core::fmt;
use core::net::Ipv4Addr;

use crate::cip::{Extra, Violation};
use crate::connection::{ConnectionType, OpenRequest, TimeoutMultiplier};
use machine::Duration;

/// A Forward_Open for cyclic data, and how it was answered.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct OpenReport {
    from: Ipv4Addr,
    /// `None` where the request could not be read.
    asked: Option<AskedConnection>,
    refused: Option<Violation>,
}

/// A requested connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct AskedConnection {
    /// Configuration, consumed and produced assembly.
    points: [Option<u32>; 3],
    o_t: AskedDirection,
    t_o: AskedDirection,
    multiplier: Option<TimeoutMultiplier>,
}

/// Connection size in bytes and packet interval in µs.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct AskedDirection {
    size: u16,
    rpi_us: u32,
}

impl OpenReport {
    /// Creates a report of a request with these points: configuration, consumed and produced assembly. Returns `None` for one that
    /// asks for no cyclic data.
    pub(super) fn new(
        from: Ipv4Addr,
        request: Result<(&OpenRequest<'_>, [Option<u32>; 3]), Violation>,
        refused: Option<Violation>,
    ) -> Option<Self> {
        let Ok((request, points)) = request else { return Some(Self { from, asked: None, refused }) };
        let OpenRequest { o_t, t_o, o_t_rpi_us, t_o_rpi_us, .. } = *request;
        let is_null = (o_t.kind, t_o.kind) == (ConnectionType::Null, ConnectionType::Null);
        if request.transport.class() != 1 || is_null {
            return None;
        }
        let asked = AskedConnection {
            points,
            o_t: AskedDirection { size: o_t.size, rpi_us: o_t_rpi_us },
            t_o: AskedDirection { size: t_o.size, rpi_us: t_o_rpi_us },
            multiplier: TimeoutMultiplier::new(request.multiplier),
        };
        Some(Self { from, asked: Some(asked), refused })
    }

    pub(super) fn write(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        let Self { from, asked, refused } = self;
        write!(words, "{from} sent a Forward_Open")?;
        if let Some(AskedConnection { points: [_, consumed, produced], o_t, t_o, multiplier }) = asked {
            for (text, assembly, AskedDirection { size, rpi_us }) in
                [(" O→T", consumed, o_t), ("; T→O", produced, t_o)]
            {
                write!(words, "{text} ")?;
                match assembly {
                    Some(assembly) => write!(words, "assembly {assembly}")?,
                    None => words.write_str("without an assembly")?,
                }
                write!(words, ", connection size {size}, every {rpi_us} µs")?;
            }
            if let Some(multiplier) = multiplier {
                let timeout = multiplier.timeout(Duration::from_micros(o_t.rpi_us.into()));
                write!(words, "; it ends {} ms after the last frame", timeout.as_secs_f64() * 1e3)?;
            }
        }
        refused.map_or(Ok(()), |violation| write_refused(words, violation))
    }
}

fn write_refused(words: &mut dyn fmt::Write, violation: Violation) -> fmt::Result {
    let status = violation.status();
    let text = status.extended.map_or(status.general.text(), |extended| extended.text());
    write!(words, "; refused: {text} (general status 0x{:02X}", u8::from(status.general))?;
    if let Some(extended) = status.extended {
        write!(words, ", extended status 0x{:04X}", u16::from(extended))?;
    }
    words.write_str(")")?;
    match status.extra {
        Some(Extra::Size(size)) => write!(words, "; this adapter has connection size {size}"),
        _ => Ok(()),
    }
}
