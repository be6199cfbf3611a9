//! Fields of every kind, read and written in both byte orders.

use machine::wire::{BigEndian, ByteOrder, LittleEndian, Overflow, Reader, Truncated, Writer};

const BIG: [u8; 19] = [
    0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x07, 0x08, 0x09, 0x0A, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F, 0xC1, 0x20,
    0x00, 0x00,
];
const LITTLE: [u8; 19] = [
    0x01, 0x03, 0x02, 0x07, 0x06, 0x05, 0x04, 0x0F, 0x0E, 0x0D, 0x0C, 0x0B, 0x0A, 0x09, 0x08, 0x00, 0x00,
    0x20, 0xC1,
];

fn assert_reads<O: ByteOrder>(bytes: &[u8; 19]) {
    let mut reader = Reader::<O>::new(bytes);
    assert_eq!(reader.u8(), Ok(0x01));
    assert_eq!(reader.u16(), Ok(0x0203));
    assert_eq!(reader.u32(), Ok(0x0405_0607));
    assert_eq!(reader.u64(), Ok(0x0809_0A0B_0C0D_0E0F));
    assert_eq!(reader.offset(), 15);
    // IEEE 754: -10 is 0xC1200000.
    assert_eq!(reader.f32(), Ok(-10.0));
    assert!(reader.is_empty());
}

fn written<O: ByteOrder>() -> ([u8; 19], Result<usize, Overflow>) {
    let mut buf = [0xEE; 19];
    let mut writer = Writer::<O>::new(&mut buf);
    writer.u8(0x01);
    writer.u16(0x0203);
    writer.u32(0x0405_0607);
    writer.u64(0x0809_0A0B_0C0D_0E0F);
    writer.f32(-10.0);
    let len = writer.finish();
    (buf, len)
}

#[test]
fn numbers_are_read_in_both_byte_orders() {
    assert_reads::<BigEndian>(&BIG);
    assert_reads::<LittleEndian>(&LITTLE);
}

#[test]
fn numbers_are_written_in_both_byte_orders() {
    assert_eq!(written::<BigEndian>(), (BIG, Ok(19)));
    assert_eq!(written::<LittleEndian>(), (LITTLE, Ok(19)));
}

#[test]
fn a_reader_stands_behind_what_it_took_or_skipped() {
    let mut reader = Reader::<BigEndian>::new(&BIG);
    assert!(!reader.is_empty());
    assert_eq!(reader.bytes(3), Ok(&BIG[..3]));
    assert_eq!((reader.offset(), reader.left()), (3, 16));
    assert_eq!(reader.bytes(2), Ok(&BIG[3..5]));
    assert_eq!(reader.offset(), 5);
    assert_eq!(reader.skip(4), Ok(()));
    assert_eq!((reader.offset(), reader.rest()), (9, &BIG[9..]));
    assert_eq!(reader.skip(11), Err(Truncated { offset: 9, wanted: 11, left: 10 }));
    assert_eq!(reader.offset(), 9);
    assert_eq!(reader.in_order::<LittleEndian>().u16(), Ok(0x0B0A));
}

#[test]
fn a_reader_sees_only_the_part_it_was_given() {
    let mut reader = Reader::<BigEndian>::new(&BIG);
    assert_eq!(reader.u8(), Ok(1));
    assert_eq!(reader.sub(2).map(|part| (part.offset(), part.rest())), Ok((0, &BIG[1..3])));
    assert_eq!(reader.offset(), 3);
}

#[test]
fn a_reader_aligns_from_its_start_and_never_beyond_its_end() {
    let mut reader = Reader::<BigEndian>::new(&BIG);
    for (skipped, alignment, offset) in [(0, 4, 0), (1, 4, 4), (1, 1, 5), (0, 0, 5), (12, 4, 19)] {
        assert_eq!(reader.skip(skipped), Ok(()));
        reader.align(alignment);
        assert_eq!(reader.offset(), offset, "after {skipped} bytes, to {alignment}");
    }
}

#[test]
fn a_writer_counts_what_it_wrote_and_aligns_with_zeros() {
    let mut buf = [0xEE; 16];
    let mut writer = Writer::<BigEndian>::new(&mut buf);
    assert!(writer.is_empty());
    assert_eq!(writer.len(), 0);
    writer.align(4);
    assert_eq!(writer.len(), 0);
    writer.bytes(&[1, 2, 3, 4, 5]);
    assert!(!writer.is_empty());
    assert_eq!(writer.len(), 5);
    writer.align(4);
    assert_eq!(writer.len(), 8);
    writer.align(4);
    writer.align(0);
    assert_eq!(writer.len(), 8);
    writer.u8(6);
    writer.pad_to(11);
    writer.pad_to(2);
    assert_eq!(writer.finish(), Ok(11));
    assert_eq!(buf, [1, 2, 3, 4, 5, 0, 0, 0, 6, 0, 0, 0xEE, 0xEE, 0xEE, 0xEE, 0xEE]);
}

#[test]
fn a_length_of_32_bits_is_patched_only_within_the_written_bytes() {
    let mut buf = [0; 8];
    let mut writer = Writer::<LittleEndian>::new(&mut buf);
    writer.zeros(5);
    writer.patch_u32(1, 0x0403_0201);
    assert_eq!(writer.finish(), Ok(5));
    assert_eq!(buf, [0, 1, 2, 3, 4, 0, 0, 0]);

    let mut writer = Writer::<LittleEndian>::new(&mut buf);
    writer.zeros(5);
    writer.patch_u32(2, 0);
    assert_eq!(writer.finish(), Err(Overflow { capacity: 8 }));
}
