//! Definitions that a bag does not hold: `PACKAGE/msg/NAME.msg` in the folder of the bag, with all that they are made of.

use std::collections::BTreeSet;
use std::io::Read as _;
use std::path::Path;

use crate::definition::plain_name;
use crate::usual;

/// Most bytes of a file, and most files of a definition.
const MOST_BYTES: u64 = 1 << 18;
const MOST_FILES: usize = 200;

/// Returns the definition of a type, or which file is sought.
pub(super) fn definition(folder: &Path, kind: &str) -> Result<String, String> {
    let name = plain_name(kind);
    let (mut text, mut known, mut due) = (String::new(), BTreeSet::from([name.clone()]), vec![name.clone()]);
    while let Some(next) = due.pop() {
        let Some(own) = read(folder, &next) else {
            match usual::definition(&next) {
                // it holds all that it is made of
                Some(usual) if next != name => {
                    text += &format!("\n===\nMSG: {next}\n{usual}");
                    continue;
                }
                _ => return Err(format!("nor is there {} beside the bag", file(&next))),
            }
        };
        let package = next.split_once('/').map_or("", |(package, _)| package);
        for used in own.lines().filter_map(|line| line.split_whitespace().next()) {
            let base = plain_name(used.split(['[', '<', '#']).next().unwrap_or_default());
            let full = if base.contains('/') { base } else { format!("{package}/{base}") };
            let plain = full.rsplit('/').next().is_none_or(|last| !last.starts_with(|c: char| c.is_ascii_uppercase()));
            if !plain
                && !full.starts_with("builtin_interfaces/")
                && known.len() < MOST_FILES
                && known.insert(full.clone())
            {
                due.push(full);
            }
        }
        text += &if next == name { own } else { format!("\n===\nMSG: {next}\n{own}") };
    }
    Ok(text)
}

fn file(name: &str) -> String {
    let (package, last) = name.split_once('/').unwrap_or(("", name));
    format!("{package}/msg/{last}.msg")
}

fn read(folder: &Path, name: &str) -> Option<String> {
    // a name from a bag must not lead elsewhere
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '/';
    if !name.chars().all(plain) || name.starts_with('/') {
        return None;
    }
    let mut text = String::new();
    std::fs::File::open(folder.join(file(name))).ok()?.take(MOST_BYTES).read_to_string(&mut text).ok()?;
    Some(text)
}
