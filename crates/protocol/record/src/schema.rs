//! The embedded schemas: for each topic's message the smallest set of descriptor files that explains it.
//!
//! A `FileDescriptorSet` is read only as deep as needed (names, packages, imports) and its files are copied byte for
//! byte, so that any protobuf reader can decode the recording without the project's sources.

use std::collections::{BTreeMap, BTreeSet};

/// One file of the descriptor set.
struct DescriptorFile<'a> {
    bytes: &'a [u8],
    imports: Vec<&'a str>,
}

/// The descriptor files by name, and the file of every message.
pub(crate) struct Schemas<'a> {
    files: BTreeMap<&'a str, DescriptorFile<'a>>,
    file_of_message: BTreeMap<String, &'a str>,
}

impl<'a> Schemas<'a> {
    /// Reads an encoded `FileDescriptorSet`; what is not one gives an empty table.
    pub(crate) fn read(descriptor_set: &'a [u8]) -> Self {
        let mut schemas = Self { files: BTreeMap::new(), file_of_message: BTreeMap::new() };
        for bytes in fields(descriptor_set).filter(|(number, _)| *number == 1).map(|(_, bytes)| bytes) {
            schemas.add(bytes);
        }
        schemas
    }

    /// FileDescriptorProto: name = 1, package = 2, dependency = 3, message_type = 4 (DescriptorProto: name = 1).
    fn add(&mut self, bytes: &'a [u8]) {
        let (mut name, mut package, mut imports, mut messages) = ("", "", Vec::new(), Vec::new());
        for (number, field) in fields(bytes) {
            match number {
                1 => name = text(field),
                2 => package = text(field),
                3 => imports.push(text(field)),
                4 => messages.extend(fields(field).find(|(inner, _)| *inner == 1).map(|(_, inner)| text(inner))),
                _ => {}
            }
        }
        for message in messages {
            let full = if package.is_empty() { message.to_owned() } else { format!("{package}.{message}") };
            self.file_of_message.insert(full, name);
        }
        self.files.insert(name, DescriptorFile { bytes, imports });
    }

    /// Returns the encoded `FileDescriptorSet` of a message: its file and all that it imports, imports first.
    pub(crate) fn of_message(&self, message: &str) -> Option<Vec<u8>> {
        let root = self.file_of_message.get(message)?;
        let (mut order, mut seen) = (Vec::new(), BTreeSet::new());
        self.collect(root, &mut seen, &mut order);
        let mut set = Vec::new();
        for file in order {
            set.push(0x0a);
            write_varint(&mut set, file.len() as u64);
            set.extend_from_slice(file);
        }
        Some(set)
    }

    fn collect(&self, name: &'a str, seen: &mut BTreeSet<&'a str>, order: &mut Vec<&'a [u8]>) {
        if !seen.insert(name) {
            return;
        }
        if let Some(file) = self.files.get(name) {
            for import in &file.imports {
                self.collect(import, seen, order);
            }
            order.push(file.bytes);
        }
    }
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap_or_default()
}

fn write_varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(0x80 | (value & 0x7f) as u8);
        value >>= 7;
    }
    out.push(value as u8);
}

fn read_varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0u64;
    for shift in (0..64).step_by(7) {
        let (first, rest) = bytes.split_first()?;
        *bytes = rest;
        value |= u64::from(first & 0x7f) << shift;
        if first & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

/// Iterates over the length-delimited fields of a message; others are skipped, a broken rest ends it.
fn fields(mut bytes: &[u8]) -> impl Iterator<Item = (u64, &[u8])> {
    std::iter::from_fn(move || {
        loop {
            let key = read_varint(&mut bytes)?;
            let length = match key & 7 {
                0 => {
                    read_varint(&mut bytes)?;
                    continue;
                }
                1 => 8,
                2 => usize::try_from(read_varint(&mut bytes)?).ok()?,
                5 => 4,
                _ => return None,
            };
            let (field, rest) = bytes.split_at_checked(length)?;
            bytes = rest;
            if key & 7 == 2 {
                return Some((key >> 3, field));
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(number: u8, bytes: &[u8]) -> Vec<u8> {
        let mut out = vec![number << 3 | 2];
        write_varint(&mut out, bytes.len() as u64);
        out.extend_from_slice(bytes);
        out
    }

    fn file(name: &str, imports: &[&str], message: &str) -> Vec<u8> {
        let mut out = [field(1, name.as_bytes()), field(2, b"p")].concat();
        for import in imports {
            out.extend(field(3, import.as_bytes()));
        }
        out.extend(field(4, &field(1, message.as_bytes())));
        field(1, &out)
    }

    #[test]
    fn a_message_takes_its_imports_along_and_no_more() {
        let (a, b, c) = (file("a", &["c"], "A"), file("b", &["c"], "B"), file("c", &[], "C"));
        let set = [a.clone(), b, c.clone()].concat();
        let schemas = Schemas::read(&set);
        assert_eq!(schemas.of_message("p.A"), Some([c.clone(), a].concat()));
        assert_eq!(schemas.of_message("p.C"), Some(c));
        assert_eq!(schemas.of_message("p.Z"), None);
    }

    #[test]
    fn a_broken_set_ends_quietly() {
        assert_eq!(Schemas::read(&[0x0a, 0xff, 0xff]).of_message("p.A"), None);
    }
}
