//! Geometries: kinds, byte orders, dimensions, and damaged ones.

use super::*;

/// Writes numbers in one byte order.
struct Writer {
    bytes: Vec<u8>,
    little: bool,
}

impl Writer {
    fn header(flags: u8, envelope: usize) -> Self {
        let mut writer = Self { bytes: vec![b'G', b'P', 0, flags], little: flags & 1 == 1 };
        writer.number(4_326);
        (0..envelope).for_each(|_| writer.real(0.0));
        writer
    }

    fn number(&mut self, value: u32) {
        self.bytes.extend(if self.little { value.to_le_bytes() } else { value.to_be_bytes() });
    }

    fn real(&mut self, value: f64) {
        self.bytes.extend(if self.little { value.to_le_bytes() } else { value.to_be_bytes() });
    }

    fn kind(&mut self, little: bool, code: u32) {
        self.little = little;
        self.bytes.push(u8::from(little));
        self.number(code);
    }

    fn points(&mut self, dimensions: usize, count: u32) {
        self.number(count);
        for i in 0..count {
            (0..dimensions).for_each(|axis| self.real(f64::from(i) + 100.0 * axis as f64));
        }
    }
}

fn line(code: u32, dimensions: usize) -> Vec<u8> {
    let mut writer = Writer::header(1, 0);
    writer.kind(true, code);
    writer.points(dimensions, 3);
    writer.bytes
}

#[test]
fn lines_are_read_in_both_byte_orders_and_with_further_dimensions() {
    let expected: Vec<DVec2> = (0..3).map(|i| DVec2::new(f64::from(i), f64::from(i) + 100.0)).collect();
    // ISO codes, and the bits of EWKB.
    for (code, dimensions) in [(2, 2), (1_002, 3), (2_002, 3), (3_002, 4), (0x8000_0002, 3), (0xC000_0002, 4)] {
        assert_eq!(read(&line(code, dimensions)).expect("a line").lines, std::slice::from_ref(&expected), "{code:#x}");
    }
    for (flags, envelope) in [(0b0010, 4), (0b0100, 6), (0b0110, 6), (0b1000, 8)] {
        let mut writer = Writer::header(flags, envelope);
        writer.kind(false, 2);
        writer.points(2, 3);
        assert_eq!(read(&writer.bytes).expect("a line").lines, std::slice::from_ref(&expected), "flags {flags:#b}");
    }
}

#[test]
fn polygons_keep_their_outer_rings_and_count_their_holes() {
    let mut writer = Writer::header(1, 0);
    writer.kind(true, 6);
    writer.number(2);
    for rings in [2, 1] {
        writer.kind(true, 3);
        writer.number(rings);
        (0..rings).for_each(|_| writer.points(2, 4));
    }
    let geometry = read(&writer.bytes).expect("two polygons");
    assert_eq!((geometry.rings.len(), geometry.holes, geometry.rings[1].len()), (2, 1, 4));
    assert_eq!(read(&Writer::header(0b1_0001, 0).bytes).expect("an empty one"), Geometry::default());
}

#[test]
fn damaged_geometries_are_refused_by_name() {
    let check = |bytes: &[u8], says: &str| {
        let error = read(bytes).expect_err(says).to_string();
        assert!(error.contains(says), "{error:?} does not say {says:?}");
    };
    let whole = line(2, 2);
    for cut in 0..whole.len() {
        check(&whole[..cut], "more bytes are needed");
    }
    let changed = |at: usize, byte: u8| {
        let mut bytes = whole.clone();
        bytes[at] = byte;
        bytes
    };
    check(&changed(0, b'X'), "does not begin with GP");
    check(&changed(2, 1), "unknown version");
    check(&changed(3, 0b10_0001), "extended");
    check(&changed(3, 0b1011), "unknown envelope");
    check(&changed(8, 7), "byte order 7 at byte 8");
    check(&changed(9, 7), "kind 7 at byte 8");
    check(&changed(16, 0xff), "more bytes are needed");
    let mut bytes = whole.clone();
    bytes[17..25].copy_from_slice(&f64::NAN.to_le_bytes());
    check(&bytes, "not finite at byte 17");
    let mut writer = Writer::header(1, 0);
    writer.kind(true, 5);
    writer.number(1);
    writer.kind(true, 3);
    writer.number(0);
    check(&writer.bytes, "kind 3");
    let mut writer = Writer::header(1, 0);
    writer.kind(true, 2);
    writer.points(2, 100_001);
    check(&writer.bytes, "more than 100000 points");
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn no_bytes_break_the_reader(
        bytes in proptest::collection::vec(proptest::num::u8::ANY, 0..200),
        kind in 0u8..8,
    ) {
        let mut made = b"GP\0\x01\xe6\x10\0\0\x01".to_vec();
        made.extend([kind, 0, 0, 0]);
        made.extend(bytes.iter().map(|byte| byte % 5));
        let _ = (read(&bytes), read(&made));
    }
}
