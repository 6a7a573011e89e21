//! MCAP: read from start to end in pieces, chunks checked by their CRC before a message is taken from them.
//!
//! The library unpacks the chunks; schemas, channels and messages are taken apart here, because its own parser believes the
//! length of a name before the bytes are there. What follows the data section is not read.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::Path;

use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::{Declared, MAX_BYTES, MAX_TOPICS, Message, Sink};
use crate::definition::Wire;
use crate::error::BagError;

/// Name, encoding and text.
type Schema = (String, String, Vec<u8>);

fn schema(rest: &mut Rest<'_>) -> Option<(u16, Schema)> {
    Some((rest.number(2)? as u16, (rest.text()?, rest.text()?, rest.counted()?.to_vec())))
}

/// Returns number, number of the schema, topic and encoding of messages.
fn channel(rest: &mut Rest<'_>) -> Option<(u16, u16, String, String)> {
    Some((rest.number(2)? as u16, rest.number(2)? as u16, rest.text()?, rest.text()?))
}

#[derive(Default)]
struct Walk {
    schemas: BTreeMap<u16, Schema>,
    known: BTreeSet<u16>,
    wanted: BTreeSet<u16>,
}

/// Opcode and length.
const HEAD: usize = 9;

/// Reads a file.
pub(super) fn read(path: &Path, sink: &mut dyn Sink) -> Result<(), BagError> {
    let failed = |source| BagError::Read { path: path.to_path_buf(), source };
    let damaged = |what: String, at: u64| BagError::Damaged { what, at, path: path.to_path_buf() };
    let cut = |at| damaged("the file breaks off (try `mcap recover`)".to_owned(), at);
    let mut file = BufReader::with_capacity(1 << 20, File::open(path).map_err(failed)?);
    let mut at = mcap::MAGIC.len() as u64;
    let mut magic = vec![0; mcap::MAGIC.len()];
    file.read_exact(&mut magic).map_err(failed)?;
    if magic != mcap::MAGIC {
        return Err(damaged("no MCAP".to_owned(), 0));
    }
    let mut walk = Walk::default();
    let mut record = Vec::new();
    loop {
        let mut head = [0; HEAD];
        file.read_exact(&mut head).map_err(|_| cut(at))?;
        let length = Rest(&head[1..]).number(8).unwrap_or(u64::MAX);
        if length > MAX_BYTES as u64 {
            return Err(damaged(format!("a record of {length} bytes, more than {MAX_BYTES},"), at));
        }
        record.clear();
        record.extend(head);
        (&mut file).take(length).read_to_end(&mut record).map_err(failed)?;
        if record.len() as u64 != HEAD as u64 + length {
            return Err(cut(at));
        }
        match head[0] {
            op::DATA_END => return Ok(()),
            op::CHUNK => walk.chunk(&record, sink, path)?,
            kind => walk.record(kind, &record[HEAD..], sink, path)?,
        }
        at += record.len() as u64;
    }
}

/// The bytes of a record that are not read yet.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn number(&mut self, size: usize) -> Option<u64> {
        let bytes = self.bytes(size)?;
        Some(bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte)))
    }

    fn counted(&mut self) -> Option<&'a [u8]> {
        let count = self.number(4)?;
        self.bytes(count as usize)
    }

    fn text(&mut self) -> Option<String> {
        self.counted().and_then(|bytes| String::from_utf8(bytes.to_vec()).ok())
    }
}

impl Walk {
    /// Reads a chunk, which the library unpacks and checks; it is shown that chunk alone, so that no record can lead out of it.
    fn chunk(&mut self, record: &[u8], sink: &mut dyn Sink, path: &Path) -> Result<(), BagError> {
        let damaged = |source| BagError::Mcap { path: path.to_path_buf(), source: Box::new(source) };
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(MAX_BYTES);
        let mut reader = LinearReader::new_with_options(options);
        let mut rest = record;
        while let Some(event) = reader.next_event() {
            match event.map_err(damaged)? {
                LinearReadEvent::ReadRequest(need) => {
                    let (now, later) = rest.split_at(need.min(rest.len()));
                    reader.insert(now.len()).copy_from_slice(now);
                    reader.notify_read(now.len());
                    rest = later;
                }
                LinearReadEvent::Record { opcode, data } => self.record(opcode, data, sink, path)?,
            }
        }
        Ok(())
    }

    fn record(&mut self, kind: u8, data: &[u8], sink: &mut dyn Sink, path: &Path) -> Result<(), BagError> {
        let damaged = |what: &str| BagError::Record { what: what.to_owned(), path: path.to_path_buf() };
        let mut rest = Rest(data);
        match kind {
            op::SCHEMA => {
                self.bounded(path)?;
                let (id, schema) = schema(&mut rest).ok_or_else(|| damaged("a schema breaks off"))?;
                self.schemas.insert(id, schema);
            }
            op::CHANNEL => {
                self.bounded(path)?;
                let (id, schema, topic, encoding) =
                    channel(&mut rest).ok_or_else(|| damaged("a channel breaks off"))?;
                if self.known.insert(id) && sink.topic(u32::from(id), self.declared(topic, schema, &encoding))? {
                    self.wanted.insert(id);
                }
            }
            op::MESSAGE => {
                let mut number = |size| rest.number(size).ok_or_else(|| damaged("a message breaks off"));
                let (id, _sequence, log, publish) = (number(2)? as u16, number(4)?, number(8)?, number(8)?);
                if self.wanted.contains(&id) {
                    let (log_nanos, publish_nanos) = (log as i64, Some(publish as i64));
                    sink.message(&Message { topic: u32::from(id), log_nanos, publish_nanos, data: rest.0 })?;
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn bounded(&self, path: &Path) -> Result<(), BagError> {
        let most = self.schemas.len().max(self.known.len());
        let error = || BagError::TooLarge { what: "topics".to_owned(), limit: MAX_TOPICS, path: path.to_path_buf() };
        if most < MAX_TOPICS { Ok(()) } else { Err(error()) }
    }

    fn declared(&self, name: String, schema: u16, encoding: &str) -> Declared {
        let wire = if encoding == "ros1" { Wire::Ros1 } else { Wire::Cdr };
        let known = self.schemas.get(&schema);
        let kind = known.map(|s| s.0.clone()).unwrap_or_default();
        let definition = match (encoding, known) {
            ("cdr" | "ros1", Some((_, text_encoding, text)))
                if ["ros1msg", "ros2msg"].contains(&text_encoding.as_str()) =>
            {
                String::from_utf8(text.clone()).map_err(|_| "its definition is no text".to_owned())
            }
            ("cdr" | "ros1", Some((_, other, _))) => {
                Err(format!("its definition is written in {other:?}; ros2msg and ros1msg are read"))
            }
            ("cdr" | "ros1", None) => Err("it has no definition".to_owned()),
            (other, _) => Err(format!("its messages are written in {other:?}; cdr and ros1 are read")),
        };
        Declared { name, kind, wire, definition }
    }
}
