//! Spoiled weight files are refused with an error that names the fault, and none makes the process grow.
//!
//! One test in a process of its own, so that the peak of its memory is that of the readers.

use std::path::Path;

use crate::files::{archive, dictionary, header, tensor, torch};
use ds_nn::checkpoint::{Checkpoint, CheckpointError, Finite, Naming};
use ds_nn::{Declared, Initial};

/// The most that reading all spoiled files may add to the peak of the process, in bytes.
const MAX_GROWTH: u64 = 32 << 20;

fn declared() -> Vec<Declared> {
    let weight = |name: &str, shape: &[usize]| Declared::new(name, shape, Initial::Constant(0.0));
    vec![weight("head.bias", &[2]), weight("head.weight", &[2, 3])]
}

fn entries() -> Vec<crate::files::Entry> {
    vec![("head.bias".to_owned(), "F32", vec![2]), ("head.weight".to_owned(), "F32", vec![2, 3])]
}

/// A safetensors file of given header and values.
fn file(entries: &[crate::files::Entry], values: &[f32]) -> Vec<u8> {
    let (header, _) = header(entries);
    [header, values.iter().flat_map(|value| value.to_le_bytes()).collect()].concat()
}

fn json(text: &str, values: usize) -> Vec<u8> {
    [(text.len() as u64).to_le_bytes().to_vec(), text.as_bytes().to_vec(), vec![0; values]].concat()
}

fn read(path: &Path) -> Result<(), CheckpointError> {
    Checkpoint::open(path)?.fit(&declared(), Naming::Plain)?.weights(Finite::Checked).map(|_| ())
}

/// The error with its causes.
fn told(error: &CheckpointError) -> String {
    let mut text = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(error) = cause {
        text = format!("{text}: {error}");
        cause = error.source();
    }
    text
}

fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or("0 kB");
    1024 * line.trim().trim_end_matches(" kB").parse::<u64>().expect("a number of kilobytes")
}

/// What was done to the file, its content, and what the error must say.
type Case = (&'static str, Vec<u8>, &'static [&'static str]);

fn safetensors_cases() -> Vec<Case> {
    let sound = file(&entries(), &[1.0; 8]);
    let with = |change: &dyn Fn(&mut Vec<crate::files::Entry>)| {
        let mut entries = entries();
        change(&mut entries);
        let (_, bytes) = header(&entries);
        file(&entries, &vec![0.0; bytes as usize / 4])
    };
    let nan = file(&entries(), &[0.0, 0.0, 0.0, f32::NAN, 0.0, 0.0, 0.0, 0.0]);
    let entry = |shape: &str, from: u64, to: u64| {
        format!("{{\"w\":{{\"dtype\":\"F32\",\"shape\":{shape},\"data_offsets\":[{from},{to}]}}}}")
    };
    let mut long = sound.clone();
    long[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    let nested = format!("{}{}", "[".repeat(100_000), "]".repeat(100_000));
    vec![
        ("missing tensor", with(&|e| drop(e.remove(0))), &["\"head.bias\" is missing"]),
        ("extra tensor", with(&|e| e.push(("odd".to_owned(), "F32", vec![1]))), &["\"odd\" is not part of the model"]),
        ("transposed", with(&|e| e[1].2 = vec![3, 2]), &["\"head.weight\"", "[3, 2]", "[2, 3] expected"]),
        ("not a number", nan, &["\"head.weight\" holds NaN at index 1"]),
        (
            "cut off in the values",
            sound[..sound.len() - 5].to_vec(),
            &["\"head.weight\"", "claims bytes 8 to 32 of 27"],
        ),
        ("cut off in the header", sound[..40].to_vec(), &["header claims", "allows 32"]),
        ("empty", Vec::new(), &["header claims 8 bytes, the file allows 0"]),
        ("a header as long as memory", long, &["header claims 18446744073709551615"]),
        ("a tensor larger than the file", json(&entry("[1073741824]", 0, 4_294_967_296), 8), &["\"w\"", "of 8"]),
        ("a size that overflows", json(&entry("[4611686018427387904,16]", 0, 0), 0), &["\"w\"", "4611686018427387904"]),
        ("overlapping", json(&entry("[1]", 4, 8), 8), &["\"w\" begins at byte 4, 0 expected"]),
        ("an unknown type", json(&entry("[1]", 0, 4).replace("F32", "Q4_0"), 4), &["\"w\"", "Q4_0"]),
        (
            "integers",
            json(&entry("[1]", 0, 8).replace("F32", "I64").replace("\"w\"", "\"head.bias\""), 8),
            &["head.bias"],
        ),
        ("nested without end", json(&nested, 0), &["header cannot be read"]),
        ("no JSON", json("tensors", 0), &["header cannot be read"]),
    ]
}

fn archive_cases() -> Vec<Case> {
    let good = tensor("FloatStorage", &[2], &[1]);
    let whole = torch(&dictionary("head.bias", &good), &[1.0; 4]);
    let code = b"cos\nsystem\n(X\x04\x00\x00\x00truetR".to_vec();
    let builtin = b"c__builtin__\neval\n(X\x01\x00\x00\x001tR".to_vec();
    let stacked = b"\x8c\x05posix\x8c\x06system\x93".to_vec();
    let of = |value: &[u8]| torch(&dictionary("head.bias", value), &[1.0; 4]);
    // A dictionary that holds itself many times, and one that is made many times over.
    let inside =
        b"}q\x00(X\x01\x00\x00\x00ah\x00X\x01\x00\x00\x00bh\x00X\x01\x00\x00\x00ch\x00X\x01\x00\x00\x00dh\x00u";
    let many = [b"\x80\x02".to_vec(), b"}".repeat(4 << 20), b".".to_vec()].concat();
    vec![
        ("code of the system", of(&code), &["\"os.system\"", "nothing was executed"]),
        ("code of the language", of(&builtin), &["\"__builtin__.eval\"", "nothing was executed"]),
        ("code in the newer form", of(&stacked), &["\"posix.system\""]),
        (
            "a tensor beyond its storage",
            of(&tensor("FloatStorage", &[9], &[1])),
            &["\"head.bias\"", "9 values", "of 4"],
        ),
        ("a tensor of one value repeated", of(&tensor("FloatStorage", &[1 << 30], &[0])), &["\"head.bias\"", "of 4"]),
        ("a negative size", of(&tensor("FloatStorage", &[u32::MAX], &[1])), &["at byte", "described wrongly"]),
        ("integers", of(&tensor("LongStorage", &[2], &[1])), &["head.bias"]),
        ("a dictionary in itself", torch(&[b"\x80\x02", &inside[..], b"."].concat(), &[]), &["holds itself"]),
        ("a million dictionaries", torch(&many, &[]), &["of memory"]),
        ("a pickle cut off", torch(&dictionary("head.bias", &good)[..60], &[]), &["pickle ends at byte"]),
        ("an archive cut off", whole[..whole.len() - 30].to_vec(), &["zip archive", "cut off"]),
        ("compressed", archive(&[("archive/data.pkl", b"x")], 8), &["data.pkl\" is compressed"]),
        ("no pickle", archive(&[("archive/readme", b"x")], 0), &["0 members data.pkl"]),
        ("a storage that is absent", archive(&[("a/data.pkl", &dictionary("b", &good))], 0), &["\"a/data/0\", absent"]),
        ("an old pickle", [b"\x80\x02}q\x00.", &[0; 16][..]].concat(), &["PyTorch before 1.6"]),
    ]
}

#[test]
fn spoiled_weights_are_named_and_cost_no_memory() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("model.bin");
    std::fs::write(&path, file(&entries(), &[1.0; 8])).expect("is written");
    read(&path).expect("the sound file is read");
    let cases = [safetensors_cases(), archive_cases()].concat();
    let before = peak();
    let mut faults = Vec::new();
    for (what, content, expected) in &cases {
        std::fs::write(&path, content).expect("is written");
        match read(&path) {
            Ok(()) => faults.push(format!("{what}: was read")),
            Err(error) => {
                let text = told(&error);
                if !expected.iter().all(|part| text.contains(part)) {
                    faults.push(format!("{what}: {text} (expected {expected:?})"));
                }
            }
        }
    }
    let growth = peak() - before;
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    eprintln!("{} spoiled files, the peak of memory grew by {growth} bytes", cases.len());
    assert!(growth < MAX_GROWTH, "the peak grew by {growth} bytes");
}
