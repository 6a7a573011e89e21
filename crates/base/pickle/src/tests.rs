//! Pickles: what Python writes in each protocol, and hostile ones.

use super::*;

#[path = "../tests/made/writer.rs"]
mod writer;
use writer::Writer;

/// Writes a value for comparison with expectations.
fn shown(pickle: &Pickle, value: Value) -> String {
    let list = |items: &[Value]| items.iter().map(|item| shown(pickle, *item)).collect::<Vec<_>>().join(",");
    match value {
        Value::Node(node) => match &pickle.nodes[node] {
            Node::Text(text) => format!("{text:?}"),
            Node::Bytes(bytes) => format!("b{bytes:?}"),
            Node::List(items) => format!("[{}]", list(items)),
            Node::Tuple(items) => format!("({})", list(items)),
            Node::Set(items) => format!("{{{}}}", list(items)),
            Node::Dict(items) => {
                let items: Vec<String> = items
                    .iter()
                    .map(|(key, value)| format!("{}:{}", shown(pickle, *key), shown(pickle, *value)))
                    .collect();
                format!("{{{}}}", items.join(","))
            }
            Node::Array(Some(array)) => format!("{:?}{:?}", array.shape, array.data),
            other => format!("{other:?}"),
        },
        other => format!("{other:?}"),
    }
}

fn check(bytes: &[u8], expected: &str) {
    let pickle = read(bytes, AllowList::Data).expect(expected);
    assert_eq!(shown(&pickle, pickle.root), expected);
}

/// The bytes are what `pickle.dumps` of CPython 3.12 gives for the value in each protocol.
#[test]
fn reads_what_python_writes_in_every_protocol() {
    // {'a': [1, 2.5, None, True], 'b': (1, 'é')}
    let expected = "{\"a\":[Int(1),Float(2.5),None,Bool(true)],\"b\":(Int(1),\"é\")}";
    check(b"(dp0\nVa\np1\n(lp2\nI1\naF2.5\naNaI01\nasVb\np3\n(I1\nV\\xe9\np4\ntp5\ns.", expected);
    check(b"}q\0(X\x01\0\0\0aq\x01]q\x02(K\x01G@\x04\0\0\0\0\0\0NI01\neX\x01\0\0\0bq\x03(K\x01X\x02\0\0\0\xc3\xa9q\x04tq\x05u.", expected);
    check(b"\x80\x02}q\0(X\x01\0\0\0aq\x01]q\x02(K\x01G@\x04\0\0\0\0\0\0N\x88eX\x01\0\0\0bq\x03K\x01X\x02\0\0\0\xc3\xa9q\x04\x86q\x05u.", expected);
    check(
        b"\x80\x05\x95\x27\0\0\0\0\0\0\0}\x94(\x8c\x01a\x94]\x94(K\x01G@\x04\0\0\0\0\0\0N\x88e\x8c\x01b\x94K\x01\x8c\x02\xc3\xa9\x94\x86\x94u.",
        expected,
    );
    // -1, -300 and 2**40 as LONG1; b'\x00\xff' of protocol 2; {1}; OrderedDict of protocol 2
    check(
        b"\x80\x02(J\xff\xff\xff\xff\x8a\x02\xd4\xfe\x8a\x06\0\0\0\0\0\x01t.",
        "(Int(-1),Int(-300),Int(1099511627776))",
    );
    check(
        b"\x80\x02c_codecs\nencode\nq\0X\x03\0\0\0\0\xc3\xbfq\x01X\x06\0\0\0latin1q\x02\x86q\x03Rq\x04.",
        "b[0, 255]",
    );
    check(b"\x80\x04\x8f\x94(K\x01\x90.", "{Int(1)}");
    check(b"\x80\x02ccollections\nOrderedDict\nq\0)Rq\x01X\x01\0\0\0aq\x02K\x01s.", "{\"a\":Int(1)}");
}

#[test]
fn reads_arrays_of_every_kind() {
    let array = |shape: &[i32], dtype: &str, bytes: &[u8]| Writer::new().array_of(shape, dtype, bytes).done();
    check(&array(&[2, 1], "f8", &[0, 0, 0, 0, 0, 0, 0, 64, 0, 0, 0, 0, 0, 0, 0, 192]), "[2, 1]Numbers([2.0, -2.0])");
    check(&array(&[1], "f4", &1.5f32.to_le_bytes()), "[1]Numbers([1.5])");
    check(&array(&[2], "i2", &[1, 0, 0xfe, 0xff]), "[2]Numbers([1.0, -2.0])");
    check(&array(&[2], "b1", &[1, 0]), "[2]Numbers([1.0, 0.0])");
    check(&array(&[1], "u8", &[1, 0, 0, 0, 0, 0, 0, 0]), "[1]Numbers([1.0])");
    check(&array(&[2], "U2", &[97, 0, 0, 0, 0, 0, 0, 0, 98, 0, 0, 0, 99, 0, 0, 0]), "[2]Texts([\"a\", \"bc\"])");
    check(&array(&[2], "S2", b"a\0bc"), "[2]Texts([\"a\", \"bc\"])");
    check(&array(&[0, 3], "f8", b""), "[0, 3]Numbers([])");
    check(&array(&[2], "U0", b""), "[2]Texts([\"\", \"\"])");
}

fn refused(bytes: &[u8], says: &str) {
    let error = read(bytes, AllowList::Data).expect_err(says).to_string();
    assert!(error.contains(says), "{error:?} does not say {says:?}");
}

#[test]
fn refuses_hostile_pickles_by_name() {
    let array = |shape: &[i32], dtype: &str, bytes: &[u8]| Writer::new().array_of(shape, dtype, bytes).done();
    // what runs code in Python
    refused(b"cos\nsystem\n(S'echo owned'\ntR.", "\"os.system\"");
    refused(b"\x80\x04\x8c\x08builtins\x94\x8c\x04eval\x94\x93\x94\x8c\x011\x94\x85\x94R\x94.", "\"builtins.eval\"");
    refused(b"cnumpy.core.multiarray\nfromfile\n.", "\"numpy.core.multiarray.fromfile\"");
    refused(b"cposix\nsystem\n.", "\"posix.system\"");
    refused(b"(S'x'\nios\nsystem\n.", "opcode 0x69");
    refused(b"Pname\n.", "opcode 0x50");
    refused(b"\x82\x01.", "opcode 0x82");
    // headers that promise more than there is
    refused(&array(&[1_250_000_000], "f8", b"12345678"), "shape [1250000000] needs 10000000000 bytes, 8 are given");
    refused(&array(&[i32::MAX, i32::MAX, i32::MAX, i32::MAX], "f8", b""), "overflows");
    refused(&array(&[-1], "f8", b""), "no size");
    refused(&array(&[i32::MAX], "U0", b""), "of memory");
    refused(&array(&[1], "V16", b""), "dtype \"V16\"");
    refused(b"\x80\x04\x8e\xff\xff\xff\xff\xff\xff\xff\x7fabc.", "more bytes are needed");
    refused(b"\x80\x04B\xff\xff\xff\xffabc.", "more bytes are needed");
    refused(b"\x8b\xff\xff\xff\x7f1.", "more bytes are needed");
    refused(b"\x8a\x0912345678\x01.", "9 bytes");
    // cycles
    refused(b"]q\0h\0a.", "list holds itself");
    refused(b"}q\0(X\x01\0\0\0ah\0u.", "dict holds itself");
    refused(b"]q\0(]q\x01h\0aee.", "malformed");
    refused(b"]q\0]q\x01h\0aa.", "holds itself");
    // a broken machine
    refused(b"", "ends at byte 0");
    refused(b"\x80\x04]", "ends at byte 3");
    refused(b".", "stack is empty");
    refused(b"t.", "no mark");
    refused(b"(K\x01u.", "stack is empty");
    refused(b"](K\x01K\x02u.", "set in a list");
    refused(b"h\x05.", "memo 5");
    refused(b"g77\n.", "memo 77");
    refused(b"\x80\x09N.", "protocol is 9");
    refused(b"K\x01K\x02R.", "no function");
    refused(b"Fabc\n.", "\"abc\" is no number");
    refused(b"X\x01\0\0\0\xff.", "malformed");
    refused(b"\x80\x04\x97.", "opcode 0x97");
    refused(&[b'('; 5000], "ends at byte 5000");
}

#[test]
fn bombs_stop_at_the_memory_limit() {
    // Each step doubles a tuple of references; flattening it would not end, counting it does not start.
    let mut doubling = b"K\x01".to_vec();
    for _ in 0..60 {
        doubling.extend(b"2\x86");
    }
    doubling.push(b'.');
    assert_eq!(read(&doubling, AllowList::Data).expect("sharing is no bomb").nodes.len(), 60);
    // A list that is extended by itself over and over through list(): every copy is charged.
    let mut copies = b"](".to_vec();
    copies.extend(vec![b'N'; 1 << 20]);
    copies.extend(b"eq\0");
    for _ in 0..200 {
        copies.extend(b"c__builtin__\nlist\nh\0\x85R");
    }
    copies.push(b'.');
    refused(&copies, "of memory");
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn no_bytes_break_the_reader(bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..200)) {
        let _ = read(&bytes, AllowList::Data);
    }

    #[test]
    fn no_change_of_a_byte_breaks_the_reader(at in 0usize..400, byte in proptest::prelude::any::<u8>()) {
        let mut bytes = Writer::new().dict(|w| {
            w.text("a").array(&[2, 2], &[1.0, 2.0, 3.0, 4.0]).text("b").list(|w| {
                w.int(1).float(2.0).none();
            });
        }).done();
        let at = at % bytes.len();
        bytes[at] = byte;
        let _ = read(&bytes, AllowList::Data);
    }
}
