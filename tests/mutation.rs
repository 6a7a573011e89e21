//! Inputs changed at random from a seed, and the limits under which readers must bear them: no panic, no more than 2 GB of
//! memory, no hang.
//!
//! The tests of the crates that own the readers include this file. A test starts itself again as a child whose memory is
//! limited, so that a reader that allocates without bound ends the child and not the tests.
#![allow(dead_code, reason = "each test uses its own part")]

use std::process::Command;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

use ds_space::Draws;

/// Inputs per kind.
pub(crate) const INPUTS: u64 = 300;
/// How long one input may take.
const PATIENCE: Duration = Duration::from_secs(60);
/// Address space of the child, KiB.
const MEMORY_KIB: u32 = 2 << 20;
/// Tells the child that it is one.
const CHILD: &str = "DREAMSTREAM_MUTATED_INPUTS";

/// Calls `read` with every index below [`INPUTS`] in a process with limits of its own; `test` is the caller's full name.
pub(crate) fn all_are_borne(test: &str, read: fn(u64)) {
    if std::env::var_os(CHILD).is_none() {
        let mut command = Command::new("sh");
        command.args(["-c", &format!("ulimit -v {MEMORY_KIB} && exec \"$0\" \"$@\"")]);
        command.arg(std::env::current_exe().expect("the test's own path")).args([test, "--exact", "--nocapture"]);
        let output = command.env(CHILD, "1").output().expect("a shell");
        let said = String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{}: {said}", output.status);
        assert!(said.contains("1 passed"), "the child ran something else: {said}");
        return;
    }
    let faults: Vec<String> = (0..INPUTS).filter_map(|index| fault(index, read)).collect();
    assert!(faults.is_empty(), "{faults:?}");
}

fn fault(index: u64, read: fn(u64)) -> Option<String> {
    let (sender, receiver) = mpsc::channel();
    let reader = std::thread::spawn(move || {
        read(index);
        sender.send(()).unwrap_or_default();
    });
    match receiver.recv_timeout(PATIENCE) {
        Ok(()) => None,
        Err(RecvTimeoutError::Timeout) => Some(format!("input {index} hangs")),
        Err(RecvTimeoutError::Disconnected) => {
            let panicked = reader.join().is_err();
            Some(format!("input {index} {}", if panicked { "panics" } else { "ends without an answer" }))
        }
    }
}

/// Returns a changed copy of bytes: flipped, overwritten, cut out, doubled, or with an extreme number in place of eight.
pub(crate) fn bytes(whole: &[u8], kind: &str, index: u64) -> Vec<u8> {
    let draws = Draws::from_seed(index, kind);
    let mut changed = whole.to_vec();
    for change in 0..=draws.below(0, 3) {
        let draw = |n: u64, below: usize| draws.below(10 * change + n, below.max(1) as u64) as usize;
        let at = draw(1, changed.len());
        let to = (at + 1 + draw(2, 32)).min(changed.len());
        match draw(3, 6) {
            0 => changed[at] ^= 1 << draw(4, 8),
            1 => changed[at..to].fill(draw(4, 256) as u8),
            2 => changed.truncate(at),
            3 => drop(changed.drain(at..to)),
            4 => {
                let span = changed[at..to].to_vec();
                changed.splice(at..at, span);
            }
            _ => {
                let number = NUMBERS[draw(4, NUMBERS.len())].to_le_bytes();
                let to = (at + 8).min(changed.len());
                changed[at..to].copy_from_slice(&number[..to - at]);
            }
        }
        if changed.is_empty() {
            break;
        }
    }
    changed
}

const NUMBERS: [f64; 8] = [1e308, -1e308, f64::NAN, f64::INFINITY, 1e-308, -0.0, 4_294_967_295.0, 1e9];

/// Returns a changed copy of a text: up to three of its numbers are others, or its bytes are changed as by [`bytes`].
pub(crate) fn text(whole: &str, kind: &str, index: u64) -> Vec<u8> {
    const WORDS: [&str; 16] = [
        "0",
        "-1",
        "1e308",
        "-1e308",
        "1e-308",
        "-0.0",
        "NaN",
        "null",
        "4294967296",
        "18446744073709551615",
        "1e9",
        "0.5",
        "",
        "\"\"",
        "1e400",
        "[]",
    ];
    if index.is_multiple_of(3) {
        return bytes(whole.as_bytes(), kind, index);
    }
    let draws = Draws::from_seed(index, kind);
    let mut changed = whole.to_owned();
    for change in 0..=draws.below(0, 3) {
        let digit = |c: char| c.is_ascii_digit();
        let from = draws.below(10 * change + 1, changed.len() as u64) as usize;
        let from = (from..changed.len()).find(|at| changed.is_char_boundary(*at)).unwrap_or_default();
        let Some(first) = changed[from..].find(digit).map(|at| from + at) else { continue };
        let start = changed[..first].rfind(|c: char| !(digit(c) || "+-.e".contains(c))).map_or(0, |at| at + 1);
        let length = changed[start..].find(|c: char| !(digit(c) || "+-.eE".contains(c)));
        let end = length.map_or(changed.len(), |length| start + length);
        let word = WORDS[draws.below(10 * change + 2, WORDS.len() as u64) as usize];
        changed.replace_range(start..end, word);
    }
    changed.into_bytes()
}
