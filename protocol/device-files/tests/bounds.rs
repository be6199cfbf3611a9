//! No file takes more than 100 MiB. The test is alone in its process, whose memory it reads.

#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use device_files::{MOST_BYTES, read};

/// Largest memory of this process so far in bytes (proc(5), VmHWM).
#[expect(clippy::disallowed_methods, reason = "the test reads its own memory")]
fn peak() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    1024 * line.trim().trim_end_matches("kB").trim().parse::<usize>().unwrap()
}

/// Fills a file up to the limit with a part between a head and a tail.
fn filled(head: &str, part: &str, tail: &str) -> Vec<u8> {
    let count = (MOST_BYTES - head.len() - tail.len()) / part.len();
    let mut bytes = Vec::with_capacity(MOST_BYTES);
    bytes.extend_from_slice(head.as_bytes());
    (0..count).for_each(|_| bytes.extend_from_slice(part.as_bytes()));
    bytes.extend_from_slice(tail.as_bytes());
    bytes
}

#[test]
fn no_file_takes_more_than_100_mib() {
    let esi = "<EtherCATInfo><Vendor><Id>1</Id></Vendor><Descriptions><Devices>";
    let texts = "<ISO15745Profile><ProfileHeader><ProfileIdentification>PROFINET</ProfileIdentification></ProfileHeader>\
        <ProfileBody><DeviceIdentity VendorID='1' DeviceID='1'/><ApplicationProcess><ExternalTextList><PrimaryLanguage>";
    let latin = b"<?xml version='1.0' encoding='iso-8859-1'?><a>\x80".to_vec();
    let hostile = [
        ("<a>", "<b/>", "</a>"),
        ("<a>", "<b c='d' e='f'/>", "</a>"),
        ("<a>", "<b>&lt;</b>", "</a>"),
        ("<a>", "&lt;", "</a>"),
        ("<a ", "c='&lt;' ", "/>"),
        ("<a>", "<", ""),
        (esi, "<Device><Type>a</Type></Device>", "</Devices></Descriptions></EtherCATInfo>"),
        (esi, "<Device><Type/></Device>", "</Devices></Descriptions></EtherCATInfo>"),
        (texts, "<Text TextId='a' Value='b'/>", ""),
        ("[A]\n", "a=,;", ""),
        ("[A]\na=", ",", ";"),
        ("[A]\na=", "\"\" ", ";"),
        ("", "[A]", ""),
        ("[Device]\n[Capacity]\n", "a=1;", ""),
    ];
    let before = peak();
    for (number, (head, part, tail)) in hostile.into_iter().enumerate() {
        // The file itself counts.
        let _ = read("a", filled(head, part, tail));
        let taken = peak().saturating_sub(before);
        assert!(taken < 100 << 20, "file {number} took {taken} bytes");
    }
    let bytes = [&latin[..], &vec![0xE4; MOST_BYTES / 2]].concat();
    let _ = read("a", bytes);
    let taken = peak().saturating_sub(before);
    assert!(taken < 100 << 20, "Latin-1 took {taken} bytes");
}
