//! Weight files made by hand: safetensors whose values are holes in the file, and archives as PyTorch writes them.

use std::fs::File;
use std::io::Write;
use std::path::Path;

/// Name, type and shape of a tensor of a file.
pub(crate) type Entry = (String, &'static str, Vec<usize>);

/// Returns the header of a safetensors file and the bytes of values that it asks for.
pub(crate) fn header(entries: &[Entry]) -> (Vec<u8>, u64) {
    let mut at = 0u64;
    let mut parts = Vec::new();
    for (name, dtype, shape) in entries {
        let size = if *dtype == "F32" { 4 } else { 2 };
        let end = at + size * shape.iter().product::<usize>() as u64;
        parts.push(format!("\"{name}\":{{\"dtype\":\"{dtype}\",\"shape\":{shape:?},\"data_offsets\":[{at},{end}]}}"));
        at = end;
    }
    let text = format!("{{{}}}", parts.join(",")).into_bytes();
    ([(text.len() as u64).to_le_bytes().to_vec(), text].concat(), at)
}

/// Writes a safetensors file whose values are all zero and take no room on disk.
pub(crate) fn write_holes(path: &Path, entries: &[Entry]) {
    let (header, bytes) = header(entries);
    let mut file = File::create(path).expect("a file");
    file.write_all(&header).expect("the header");
    file.set_len(header.len() as u64 + bytes).expect("the length");
}

/// Writes a zip archive of stored members.
pub(crate) fn archive(members: &[(&str, &[u8])], method: u16) -> Vec<u8> {
    let (mut file, mut directory) = (Vec::new(), Vec::new());
    for (name, data) in members {
        let start = file.len() as u32;
        let sizes = [data.len() as u32, data.len() as u32].map(u32::to_le_bytes).concat();
        // Version; then flags, method, time, date and checksum, all zero but the method.
        let mut local = [&b"PK\x03\x04"[..], &[20, 0], &[0; 12], &sizes].concat();
        local.extend([(name.len() as u16).to_le_bytes(), [0; 2]].concat());
        local[8..10].copy_from_slice(&method.to_le_bytes());
        file.extend([local, name.as_bytes().to_vec(), data.to_vec()].concat());
        let mut entry = vec![0; 46];
        entry[..4].copy_from_slice(b"PK\x01\x02");
        entry[10..12].copy_from_slice(&method.to_le_bytes());
        entry[20..28].copy_from_slice(&sizes);
        entry[28..30].copy_from_slice(&(name.len() as u16).to_le_bytes());
        entry[42..46].copy_from_slice(&start.to_le_bytes());
        directory.extend([entry, name.as_bytes().to_vec()].concat());
    }
    let mut end = vec![0; 22];
    end[..4].copy_from_slice(b"PK\x05\x06");
    end[10..12].copy_from_slice(&(members.len() as u16).to_le_bytes());
    end[12..16].copy_from_slice(&(directory.len() as u32).to_le_bytes());
    end[16..20].copy_from_slice(&(file.len() as u32).to_le_bytes());
    [file, directory, end].concat()
}

fn text(value: &str) -> Vec<u8> {
    [b"X".to_vec(), (value.len() as u32).to_le_bytes().to_vec(), value.as_bytes().to_vec()].concat()
}

fn sizes(values: &[u32]) -> Vec<u8> {
    let each = |value: &u32| [b"J".to_vec(), value.to_le_bytes().to_vec()].concat();
    [b"(".to_vec(), values.iter().flat_map(each).collect(), b"t".to_vec()].concat()
}

/// Pickles a tensor over storage 0 of `storage` type.
pub(crate) fn tensor(storage: &str, shape: &[u32], strides: &[u32]) -> Vec<u8> {
    [
        b"ctorch._utils\n_rebuild_tensor_v2\n((".to_vec(),
        text("storage"),
        format!("ctorch\n{storage}\n").into_bytes(),
        text("0"),
        text("cpu"),
        b"K\x04tQK\x00".to_vec(),
        sizes(shape),
        sizes(strides),
        b"\x89ccollections\nOrderedDict\n)RtR".to_vec(),
    ]
    .concat()
}

/// Pickles a dictionary of one entry.
pub(crate) fn dictionary(name: &str, value: &[u8]) -> Vec<u8> {
    [b"\x80\x02}".to_vec(), text(name), value.to_vec(), b"s.".to_vec()].concat()
}

/// An archive that holds a pickle and one storage.
pub(crate) fn torch(pickle: &[u8], storage: &[f32]) -> Vec<u8> {
    let values: Vec<u8> = storage.iter().flat_map(|value| value.to_le_bytes()).collect();
    archive(&[("archive/data.pkl", pickle), ("archive/byteorder", b"little"), ("archive/data/0", &values)], 0)
}
