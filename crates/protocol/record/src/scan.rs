//! A tolerant reader of the container: whole file in memory → segments that were closed by a commit.
//!
//! A segment is what lies between two marks (`dreamstream.begin`, `dreamstream.commit`, `dreamstream.complete`). Reading
//! stops at the first cut or broken record; messages after the last mark were never committed and are dropped. Chunks
//! are checked by their CRC before a message is taken from them; sizes are bounded before anything is allocated.

use std::collections::BTreeMap;
use std::path::Path;

use bytes::Bytes;
use mcap::records::{Metadata, Record, op};
use mcap::sans_io::LinearReaderOptions;

use crate::channel::ChannelKey;
use crate::error::RecordError;
use crate::linear;

/// The mark after the scene: the recording has begun.
pub(crate) const BEGIN: &str = "dreamstream.begin";
/// The mark after each committed iteration.
pub(crate) const COMMIT: &str = "dreamstream.commit";
/// The mark of a complete recording.
pub(crate) const COMPLETE: &str = "dreamstream.complete";
/// The entry of a mark that says how many messages it closes.
pub(crate) const CLOSES: &str = "closes";

/// The most bytes of messages that are read from one file.
pub const MAX_RECORDING_BYTES: u64 = 4 << 30;
/// Opcode and length.
const RECORD_HEAD: usize = 9;

/// The messages between two marks.
pub(crate) struct Segment {
    /// The mark that closed it.
    pub(crate) mark: Metadata,
    /// The messages in file order.
    pub(crate) messages: Vec<(ChannelKey, Bytes)>,
}

/// What a file holds.
pub(crate) struct Scan {
    /// The closed segments in file order.
    pub(crate) segments: Vec<Segment>,
    /// Messages that no mark closed.
    pub(crate) dropped: u64,
    /// Where and why reading stopped before the end of the data, if it did.
    pub(crate) stopped: Option<(u64, String)>,
}

/// Reads a file that is already in memory.
pub(crate) fn scan(bytes: &[u8], path: &Path) -> Result<Scan, RecordError> {
    if !bytes.starts_with(mcap::MAGIC) {
        return Err(RecordError::Foreign { what: "no MCAP magic bytes".to_owned(), path: path.to_path_buf() });
    }
    let mut walk = Walk::default();
    let mut offset = mcap::MAGIC.len();
    let mut stopped = None;
    while offset < bytes.len() {
        match walk.record(&bytes[offset..]) {
            Ok(Step::Next(length)) => offset += length,
            Ok(Step::End) => break,
            Err(Fault::Stop(why)) => {
                stopped = Some((offset as u64, why));
                break;
            }
            Err(Fault::TooLarge(found)) => {
                return Err(RecordError::TooLarge { found, limit: MAX_RECORDING_BYTES });
            }
        }
    }
    let dropped = walk.open.len() as u64;
    Ok(Scan { segments: walk.segments, dropped, stopped })
}

enum Step {
    Next(usize),
    End,
}

enum Fault {
    Stop(String),
    TooLarge(u64),
}

fn stop(why: impl ToString) -> Fault {
    Fault::Stop(why.to_string())
}

/// Parses a record whose texts end inside it: the library allocates what a text's length says before it reads.
fn parse(opcode: u8, body: &[u8]) -> Result<Record<'_>, Fault> {
    texts_fit(opcode, body).ok_or_else(|| stop("a text is longer than its record"))?;
    mcap::parse_record(opcode, body).map_err(stop)
}

fn texts_fit(opcode: u8, body: &[u8]) -> Option<()> {
    // Bytes of ids, then texts (the data of a schema as one), then a map of texts.
    let (ids, texts, maps) = match opcode {
        op::SCHEMA => (2, 3, 0),
        op::CHANNEL => (4, 2, 1),
        op::METADATA => (0, 1, 1),
        _ => return Some(()),
    };
    let mut rest = body.get(ids..)?;
    for _ in 0..texts {
        rest = text(rest)?.1;
    }
    for _ in 0..maps {
        let mut entries = text(rest)?.0;
        while !entries.is_empty() {
            entries = text(entries)?.1;
        }
    }
    Some(())
}

/// Divides bytes into the text at their start and the rest.
fn text(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_at_checked(4)?;
    rest.split_at_checked(u32::from_le_bytes(length.try_into().ok()?) as usize)
}

#[derive(Default)]
struct Walk {
    channels: BTreeMap<u16, ChannelKey>,
    open: Vec<(ChannelKey, Bytes)>,
    segments: Vec<Segment>,
    bytes: u64,
}

impl Walk {
    /// Reads the record at the start of `rest` and returns its length.
    fn record(&mut self, rest: &[u8]) -> Result<Step, Fault> {
        let head = rest.get(..RECORD_HEAD).ok_or_else(|| stop("the file ends inside a record"))?;
        let announced = u64::from_le_bytes(head[1..].try_into().map_err(|_| stop("no length"))?);
        let body = usize::try_from(announced)
            .ok()
            .and_then(|length| rest.get(RECORD_HEAD..RECORD_HEAD.checked_add(length)?))
            .ok_or_else(|| stop("the file ends inside a record"))?;
        match head[0] {
            op::DATA_END | op::FOOTER => return Ok(Step::End),
            op::CHUNK => self.chunk(&rest[..RECORD_HEAD + body.len()])?,
            op::METADATA | op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                self.take(parse(head[0], body)?)?;
            }
            0 => return Err(stop("a record of kind 0")),
            _ => {}
        }
        Ok(Step::Next(RECORD_HEAD + body.len()))
    }

    fn chunk(&mut self, record: &[u8]) -> Result<(), Fault> {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true);
        linear::each(record, options, stop, |opcode, data| self.take(parse(opcode, data)?))
    }

    fn take(&mut self, record: Record<'_>) -> Result<(), Fault> {
        match record {
            Record::Channel(channel) => {
                if let Some(key) = ChannelKey::from_metadata(&channel.metadata) {
                    self.channels.insert(channel.id, key);
                }
            }
            Record::Message { header, data } => {
                self.bytes += data.len() as u64;
                if self.bytes > MAX_RECORDING_BYTES {
                    return Err(Fault::TooLarge(self.bytes));
                }
                if let Some(key) = self.channels.get(&header.channel_id) {
                    self.open.push((*key, Bytes::from(data.into_owned())));
                }
            }
            Record::Metadata(mark) if [BEGIN, COMMIT, COMPLETE].contains(&mark.name.as_str()) => {
                let found = self.open.len().to_string();
                if mark.metadata.get(CLOSES) != Some(&found) {
                    return Err(stop(format!(
                        "{} closes {:?} messages, {found} are there",
                        mark.name,
                        mark.metadata.get(CLOSES)
                    )));
                }
                let messages = std::mem::take(&mut self.open);
                self.segments.push(Segment { mark, messages });
            }
            _ => {}
        }
        Ok(())
    }
}
