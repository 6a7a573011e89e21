//! ROS 1 bag 2.0: records of a header (fields `name=value`, each with its length) and data, in chunks that may be
//! compressed by LZ4 or bzip2; <http://wiki.ros.org/Bags/Format/2.0>.
//!
//! The index at the end is not read: a bag whose recorder was killed is read up to where it breaks off, which is an error.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead as _, BufReader, Read};
use std::path::Path;

use super::{Declared, MAX_BYTES, MAX_TOPICS, Message, Sink};
use crate::definition::Wire;
use crate::error::BagError;

/// First bytes of a bag.
pub(super) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

const MESSAGE: u8 = 0x02;
const CHUNK: u8 = 0x05;
const CONNECTION: u8 = 0x07;

/// Reads a file.
pub(super) fn read(path: &Path, sink: &mut dyn Sink) -> Result<(), BagError> {
    let failed = |source| BagError::Read { path: path.to_path_buf(), source };
    let mut file = BufReader::with_capacity(1 << 20, File::open(path).map_err(failed)?);
    let damaged = |what: String, at: u64| BagError::Damaged { what, at, path: path.to_path_buf() };
    let mut magic = vec![0; MAGIC.len()];
    file.read_exact(&mut magic).map_err(failed)?;
    if magic != MAGIC {
        return Err(damaged("no ROS bag of version 2.0".to_owned(), 0));
    }
    let mut walk = Walk { wanted: BTreeSet::new(), known: BTreeSet::new(), path, at: MAGIC.len() as u64 };
    let (mut header, mut data) = (Vec::new(), Vec::new());
    while !file.fill_buf().map_err(failed)?.is_empty() {
        let taken = take(&mut file, &mut header).and_then(|a| Ok(a + take(&mut file, &mut data)?));
        let taken = taken.map_err(|what| damaged(what, walk.at))?;
        walk.record(&header, &data, sink, 0)?;
        walk.at += taken;
    }
    Ok(())
}

/// Reads a length and so many bytes; returns how many in all.
fn take(source: &mut impl Read, into: &mut Vec<u8>) -> Result<u64, String> {
    let cut = "the bag breaks off (try `rosbag reindex`)";
    let mut length = [0; 4];
    source.read_exact(&mut length).map_err(|_| cut.to_owned())?;
    let length = u32::from_le_bytes(length) as usize;
    if length > MAX_BYTES {
        return Err(format!("a record of {length} bytes, more than {MAX_BYTES},"));
    }
    into.clear();
    source.take(length as u64).read_to_end(into).map_err(|e| e.to_string())?;
    if into.len() < length { Err(cut.to_owned()) } else { Ok(length as u64 + 4) }
}

/// Fields of a header.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    /// Returns a field's bytes.
    fn get(&self, name: &str) -> Option<&'a [u8]> {
        let mut rest = self.0;
        while let Some((length, after)) = rest.split_first_chunk::<4>() {
            let (field, after) = after.split_at_checked(u32::from_le_bytes(*length) as usize)?;
            let equals = field.iter().position(|b| *b == b'=')?;
            if &field[..equals] == name.as_bytes() {
                return Some(&field[equals + 1..]);
            }
            rest = after;
        }
        None
    }

    fn number(&self, name: &str) -> Result<u32, String> {
        let bytes = self.get(name).and_then(|b| b.first_chunk::<4>());
        bytes.map(|b| u32::from_le_bytes(*b)).ok_or_else(|| format!("a record without {name}"))
    }

    fn text(&self, name: &str) -> Result<String, String> {
        let bytes = self.get(name).ok_or_else(|| format!("a connection without {name}"))?;
        String::from_utf8(bytes.to_vec()).map_err(|_| format!("a connection whose {name} is no text"))
    }
}

struct Walk<'a> {
    known: BTreeSet<u32>,
    wanted: BTreeSet<u32>,
    path: &'a Path,
    at: u64,
}

impl Walk<'_> {
    fn record(&mut self, header: &[u8], data: &[u8], sink: &mut dyn Sink, depth: u32) -> Result<(), BagError> {
        let (at, path) = (self.at, self.path);
        let damaged = move |what: String| BagError::Damaged { what, at, path: path.to_path_buf() };
        let fields = Fields(header);
        let code = fields.get("op").and_then(<[u8]>::first).copied();
        match code.ok_or_else(|| damaged("a record without op".to_owned()))? {
            MESSAGE => {
                let topic = fields.number("conn").map_err(damaged)?;
                if !self.wanted.contains(&topic) {
                    return Ok(());
                }
                let time = fields.get("time").and_then(|b| b.first_chunk::<8>());
                let time = u64::from_le_bytes(*time.ok_or_else(|| damaged("a message without time".to_owned()))?);
                let log_nanos = (time & 0xffff_ffff) as i64 * 1_000_000_000 + (time >> 32) as i64;
                sink.message(&Message { topic, log_nanos, publish_nanos: None, data })
            }
            CONNECTION => {
                let (number, declared) = connection(&fields, data).map_err(damaged)?;
                if self.known.len() >= MAX_TOPICS {
                    let what = "topics".to_owned();
                    return Err(BagError::TooLarge { what, limit: MAX_TOPICS, path: self.path.to_path_buf() });
                }
                if self.known.insert(number) && sink.topic(number, declared)? {
                    self.wanted.insert(number);
                }
                Ok(())
            }
            CHUNK if depth == 0 => {
                let plain = chunk(&fields, data).map_err(damaged)?;
                let mut rest = plain.as_deref().unwrap_or(data);
                while !rest.is_empty() {
                    let (header, after) = slice(rest).ok_or_else(|| damaged("a chunk that breaks off".to_owned()))?;
                    let (data, after) = slice(after).ok_or_else(|| damaged("a chunk that breaks off".to_owned()))?;
                    self.record(header, data, sink, 1)?;
                    rest = after;
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

/// Splits off a length and so many bytes.
fn slice(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    rest.split_at_checked(u32::from_le_bytes(*length) as usize)
}

fn connection(fields: &Fields<'_>, data: &[u8]) -> Result<(u32, Declared), String> {
    let inner = Fields(data);
    let definition = inner.text("message_definition");
    let declared = Declared { name: fields.text("topic")?, kind: inner.text("type")?, wire: Wire::Ros1, definition };
    Ok((fields.number("conn")?, declared))
}

/// Returns the bytes of a chunk, `None` where they are written as they are.
fn chunk(fields: &Fields<'_>, data: &[u8]) -> Result<Option<Vec<u8>>, String> {
    let size = fields.number("size")? as usize;
    if size > MAX_BYTES {
        return Err(format!("a chunk of {size} bytes, more than {MAX_BYTES},"));
    }
    let mut unpacked: Box<dyn Read> = match fields.get("compression").unwrap_or_default() {
        b"none" => return Ok(None),
        b"lz4" => Box::new(lz4_flex::frame::FrameDecoder::new(data)),
        b"bz2" => Box::new(bzip2_rs::DecoderReader::new(data)),
        other => {
            return Err(format!(
                "a chunk compressed by {:?}; none, lz4 and bz2 are known",
                String::from_utf8_lossy(other)
            ));
        }
    };
    let mut plain = Vec::new();
    (&mut unpacked).take(size as u64 + 1).read_to_end(&mut plain).map_err(|e| format!("a damaged chunk ({e})"))?;
    if plain.len() != size {
        return Err(format!("a chunk that says {size} bytes and holds {}", plain.len()));
    }
    Ok(Some(plain))
}
