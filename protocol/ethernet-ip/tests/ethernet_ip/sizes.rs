//! Refused sizes: a refusal counts sequence count, header and data, a setup counts data.

use ethernet_ip::ConnectionConfig;
use ethernet_ip::connection::RealTimeFormat;

use crate::cell::wanted;
use crate::scanner_hostile::asked_for_identity_by;

#[test]
fn a_refused_size_is_quoted_as_the_bytes_of_data_that_a_setup_has_in_each_direction_and_format() {
    use RealTimeFormat::{Heartbeat, Modeless, RunIdleHeader};
    const SIZES: [(u16, [RealTimeFormat; 2], u16, &str); 8] = [
        (0x0127, [RunIdleHeader, Modeless], 38, "; the device has 32 bytes of data (connection size 38 with"),
        (0x0127, [Modeless, Modeless], 38, "; the device has 36 bytes of data (connection size 38 with"),
        (0x0128, [RunIdleHeader, Modeless], 38, "; the device has 36 bytes of data (connection size 38 with"),
        (0x0128, [Modeless, RunIdleHeader], 38, "; the device has 32 bytes of data (connection size 38 with"),
        (0x0134, [RunIdleHeader, Modeless], 12, "; the device has 10 bytes of data (connection size 12 with"),
        (
            0x0109,
            [RunIdleHeader, Modeless],
            70,
            "; the device takes 64 bytes of data O→T, or 68 bytes of data T→O",
        ),
        (0x0127, [RunIdleHeader, Modeless], 3, "; the device has no data (connection size 3 with"),
        (0x0127, [Heartbeat, Modeless], 8, "; the device has 6 bytes of data (connection size 8 with"),
    ];
    for (extended, [consumed_format, produced_format], size, expected) in SIZES {
        let config =
            ConnectionConfig { o_t_size: 17, t_o_size: 17, consumed_format, produced_format, ..wanted() };
        let (mut dialogue, question) = asked_for_identity_by(config);
        let (said, _) = dialogue.reply_cip(&question, &[0x81, 0, 0x08, 0]);
        let ([low, high], [size_low, size_high]) = (extended.to_le_bytes(), size.to_le_bytes());
        dialogue.reply_cip(&said[0], &[0xD4, 0, 1, 2, low, high, size_low, size_high]);
        let words = dialogue.scanner.connection().refusal().unwrap().to_string();
        assert!(words.contains(expected), "0x{extended:04X}: {words}");
        let asked = match extended {
            0x0127 if consumed_format == Heartbeat => "asked for 0 bytes of data O→T to assembly 150",
            0x0127 => "asked for 17 bytes of data O→T to assembly 150",
            0x0109 => " and 17 bytes of data T→O from assembly 100",
            _ => "asked for 17 bytes of data T→O from assembly 100",
        };
        assert!(words.contains(asked), "0x{extended:04X}: {words}");
    }
}
