//! Feather files (version 2: Arrow IPC files) of plain columns: integers, floats, booleans, texts; LZ4 and ZSTD.
//!
//! The metadata are verified by the generated readers of `arrow-ipc`; its own file reader is not used because it panics
//! on buffers that lie outside of a file. Dictionaries and nested columns are refused. Nulls become NaN and empty texts.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Read;

use arrow_ipc::{
    Block, BodyCompressionMethod, CompressionType, Field, Precision, RecordBatch, Type, root_as_footer, root_as_message,
};

use super::column::{Column, MAX_ROWS};
use crate::file::MAX_FILE_BYTES;
use crate::view::FieldFault;

const MAGIC: &[u8] = b"ARROW1";
/// The longest text of a cell, in bytes.
const MAX_TEXT_BYTES: usize = 160;

/// How the cells of a column are laid out.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Layout {
    Bool,
    Signed(usize),
    Unsigned(usize),
    Float(usize),
    /// Texts, offsets of so many bytes.
    Text(usize),
}

impl Layout {
    fn of(field: Field<'_>) -> Option<Self> {
        if field.dictionary().is_some() {
            return None;
        }
        match field.type_type() {
            Type::Bool => Some(Self::Bool),
            Type::Utf8 => Some(Self::Text(4)),
            Type::LargeUtf8 => Some(Self::Text(8)),
            Type::Int => {
                let int = field.type_as_int()?;
                let width = usize::try_from(int.bitWidth()).ok().filter(|bits| matches!(bits, 8 | 16 | 32 | 64))? / 8;
                Some(if int.is_signed() { Self::Signed(width) } else { Self::Unsigned(width) })
            }
            Type::FloatingPoint => match field.type_as_floating_point()?.precision() {
                Precision::SINGLE => Some(Self::Float(4)),
                Precision::DOUBLE => Some(Self::Float(8)),
                _ => None,
            },
            _ => None,
        }
    }

    fn buffers(self) -> usize {
        if matches!(self, Self::Text(_)) { 3 } else { 2 }
    }

    fn empty(self) -> Column {
        if matches!(self, Self::Text(_)) { Column::Texts(Vec::new()) } else { Column::Numbers(Vec::new()) }
    }
}

/// Reads those of the wanted columns that a file has.
pub(super) fn columns(bytes: &[u8], wanted: &[&str]) -> Result<(usize, BTreeMap<String, Column>), FieldFault> {
    let fault = |at: &str, problem: &str| FieldFault { at: at.to_owned(), problem: problem.to_owned() };
    if bytes.starts_with(b"FEA1") {
        return Err(fault("file", "is Feather version 1, only version 2 is read"));
    }
    let footer = footer(bytes).ok_or_else(|| fault("file", "is no whole Feather file: it has no sound footer"))?;
    let footer = root_as_footer(footer).map_err(|error| fault("footer", &format!("is refused: {error}")))?;
    let fields = footer.schema().and_then(|schema| schema.fields()).ok_or_else(|| fault("schema", "is missing"))?;
    let mut layouts = Vec::new();
    for field in fields {
        let name = field.name().unwrap_or_default();
        let problem = || fault(name, &format!("is of type {:?}, which is not read", field.type_type()));
        layouts.push((name, Layout::of(field).ok_or_else(problem)?));
    }
    let is_wanted = |name: &str| wanted.contains(&name);
    let mut columns: BTreeMap<String, Column> = layouts
        .iter()
        .filter(|(name, _)| is_wanted(name))
        .map(|(name, kind)| ((*name).to_owned(), kind.empty()))
        .collect();
    let (mut rows, mut budget) = (0usize, MAX_FILE_BYTES);
    for (number, block) in footer.recordBatches().into_iter().flatten().enumerate() {
        let at = format!("batch {number}");
        let (message, body) = parts(bytes, *block).ok_or_else(|| fault(&at, "lies outside of the file"))?;
        let message = root_as_message(message).map_err(|error| fault(&at, &format!("is refused: {error}")))?;
        let batch = message.header_as_record_batch().ok_or_else(|| fault(&at, "is no record batch"))?;
        let count = usize::try_from(batch.length()).ok().filter(|count| *count <= MAX_ROWS - rows);
        let count =
            count.ok_or_else(|| fault(&at, &format!("has {} rows, over the limit of {MAX_ROWS}", batch.length())))?;
        rows += count;
        let mut body = Body { batch, bytes: body, count, budget: &mut budget };
        let mut first = 0;
        for (index, (name, layout)) in layouts.iter().enumerate() {
            if let Some(column) = columns.get_mut(*name) {
                body.read(*layout, index, first, column)
                    .map_err(|problem| fault(&format!("{at}, {name}"), &problem))?;
            }
            first += layout.buffers();
        }
    }
    Ok((rows, columns))
}

fn footer(bytes: &[u8]) -> Option<&[u8]> {
    let rest = bytes.strip_suffix(MAGIC).filter(|_| bytes.starts_with(MAGIC))?;
    let (rest, length) = rest.split_last_chunk::<4>()?;
    let length = usize::try_from(i32::from_le_bytes(*length)).ok()?;
    rest.get(rest.len().checked_sub(length)?..)
}

/// Returns the message and the body of a block.
fn parts(bytes: &[u8], block: Block) -> Option<(&[u8], &[u8])> {
    let part = |offset: i64, length: i64| {
        let (offset, length) = (usize::try_from(offset).ok()?, usize::try_from(length).ok()?);
        bytes.get(offset..offset.checked_add(length)?)
    };
    let message = part(block.offset(), i64::from(block.metaDataLength()))?;
    let body = part(block.offset().checked_add(i64::from(block.metaDataLength()))?, block.bodyLength())?;
    // Before the message stand its length and, in all but old files, a mark.
    let message = message.strip_prefix(&[0xff; 4]).unwrap_or(message).get(4..)?;
    Some((message, body))
}

/// The buffers of a batch.
struct Body<'a, 'b> {
    batch: RecordBatch<'a>,
    bytes: &'a [u8],
    count: usize,
    /// How many bytes may still be taken from this file.
    budget: &'b mut u64,
}

impl<'a> Body<'a, '_> {
    /// Adds the cells of a column, whose place among the columns and whose first buffer are given.
    fn read(&mut self, layout: Layout, index: usize, first: usize, column: &mut Column) -> Result<(), String> {
        let nodes = self.batch.nodes().filter(|nodes| index < nodes.len()).ok_or("has no node")?;
        if nodes.get(index).length() != self.batch.length() {
            return Err(format!("has {} cells in a batch of {} rows", nodes.get(index).length(), self.batch.length()));
        }
        let count = self.count;
        if count == 0 {
            return Ok(());
        }
        let valid = self.buffer(first)?;
        let no_null = nodes.get(index).null_count() == 0 || valid.is_empty();
        let short = || format!("has too few bytes for {count} cells");
        if !no_null && valid.len() < count.div_ceil(8) {
            return Err(short());
        }
        let is_null = |row: usize| !no_null && valid[row / 8] >> (row % 8) & 1 == 0;
        let data = self.buffer(first + 1)?;
        match column {
            Column::Texts(texts) => {
                let values = self.buffer(first + 2)?;
                let Layout::Text(width) = layout else { return Err("has cells of two kinds".to_owned()) };
                let offsets = integers(&data, count + 1, width).ok_or_else(short)?;
                for (row, pair) in offsets.windows(2).enumerate() {
                    let found = if is_null(row) { Some(String::new()) } else { text(&values, pair) };
                    texts.push(
                        found.ok_or_else(|| format!("has no text of up to {MAX_TEXT_BYTES} bytes in cell {row}"))?,
                    );
                }
            }
            Column::Numbers(numbers) => {
                let cells = cells(layout, &data, count).ok_or_else(short)?;
                numbers.extend(
                    cells.into_iter().enumerate().map(|(row, cell)| if is_null(row) { f64::NAN } else { cell }),
                );
            }
        }
        Ok(())
    }

    fn buffer(&mut self, index: usize) -> Result<Cow<'a, [u8]>, String> {
        let outside = || format!("has buffer {index} outside of the file");
        let buffer = self.batch.buffers().filter(|buffers| index < buffers.len()).map(|buffers| *buffers.get(index));
        let range = buffer.and_then(|buffer| {
            let offset = usize::try_from(buffer.offset()).ok()?;
            Some(offset..offset.checked_add(usize::try_from(buffer.length()).ok()?)?)
        });
        let bytes = self.bytes;
        let raw = range.and_then(|range| bytes.get(range)).ok_or_else(outside)?;
        let mut take = |length: u64| {
            *self.budget = self.budget.checked_sub(length).ok_or_else(|| format!("has over {MAX_FILE_BYTES} bytes"))?;
            Ok::<u64, String>(length)
        };
        let Some(compression) = self.batch.compression().filter(|_| !raw.is_empty()) else {
            take(raw.len() as u64)?;
            return Ok(Cow::Borrowed(raw));
        };
        let (length, packed) = raw.split_first_chunk::<8>().ok_or_else(outside)?;
        let length = i64::from_le_bytes(*length);
        if length == -1 {
            take(packed.len() as u64)?;
            return Ok(Cow::Borrowed(packed));
        }
        let length = take(u64::try_from(length).map_err(|_negative| outside())?)?;
        if compression.method() != BodyCompressionMethod::BUFFER {
            return Err("is compressed in an unknown way".to_owned());
        }
        unpacked(packed, compression.codec(), length).map(Cow::Owned)
    }
}

fn unpacked(packed: &[u8], codec: CompressionType, length: u64) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let broken = |error: std::io::Error| format!("is not to be unpacked: {error}");
    match codec {
        CompressionType::LZ4_FRAME => {
            lz4_flex::frame::FrameDecoder::new(packed).take(length + 1).read_to_end(&mut bytes)
        }
        CompressionType::ZSTD => zstd::stream::read::Decoder::new(packed)
            .and_then(|decoder| decoder.take(length + 1).read_to_end(&mut bytes)),
        _ => return Err("is compressed in an unknown way".to_owned()),
    }
    .map_err(broken)?;
    if bytes.len() as u64 == length {
        Ok(bytes)
    } else {
        Err(format!("has {} unpacked bytes, not {length}", bytes.len()))
    }
}

fn each<const W: usize, T>(data: &[u8], count: usize, value: impl Fn([u8; W]) -> T) -> Option<Vec<T>> {
    let data = data.get(..count.checked_mul(W)?)?;
    Some(data.as_chunks::<W>().0.iter().map(|chunk| value(*chunk)).collect())
}

fn integers(data: &[u8], count: usize, width: usize) -> Option<Vec<i64>> {
    match width {
        1 => each(data, count, |bytes| i64::from(i8::from_le_bytes(bytes))),
        2 => each(data, count, |bytes| i64::from(i16::from_le_bytes(bytes))),
        4 => each(data, count, |bytes| i64::from(i32::from_le_bytes(bytes))),
        _ => each(data, count, i64::from_le_bytes),
    }
}

fn cells(layout: Layout, data: &[u8], count: usize) -> Option<Vec<f64>> {
    match layout {
        Layout::Bool => (0..count).map(|row| Some(f64::from(data.get(row / 8)? >> (row % 8) & 1))).collect(),
        Layout::Signed(width) => Some(integers(data, count, width)?.into_iter().map(|value| value as f64).collect()),
        Layout::Unsigned(1) => each(data, count, |bytes| f64::from(u8::from_le_bytes(bytes))),
        Layout::Unsigned(2) => each(data, count, |bytes| f64::from(u16::from_le_bytes(bytes))),
        Layout::Unsigned(4) => each(data, count, |bytes| f64::from(u32::from_le_bytes(bytes))),
        Layout::Unsigned(_) => each(data, count, |bytes| u64::from_le_bytes(bytes) as f64),
        Layout::Float(4) => each(data, count, |bytes| f64::from(f32::from_le_bytes(bytes))),
        Layout::Float(_) => each(data, count, f64::from_le_bytes),
        Layout::Text(_) => None,
    }
}

fn text(values: &[u8], pair: &[i64]) -> Option<String> {
    let bytes = values.get(usize::try_from(pair[0]).ok()?..usize::try_from(pair[1]).ok()?)?;
    let text = std::str::from_utf8(bytes).ok().filter(|text| text.len() <= MAX_TEXT_BYTES)?;
    Some(text.to_owned())
}
