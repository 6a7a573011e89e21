//! The directory of a zip archive as PyTorch writes it: members are stored, never compressed, so each is a byte range.
//!
//! Read from the mapped archive without unpacking anything; sizes are checked against the file.

use std::collections::BTreeMap;
use std::ops::Range;

const END: [u8; 4] = *b"PK\x05\x06";
const END_64: [u8; 4] = *b"PK\x06\x06";
const LOCATOR_64: [u8; 4] = *b"PK\x06\x07";
const ENTRY: [u8; 4] = *b"PK\x01\x02";
const MEMBER: [u8; 4] = *b"PK\x03\x04";
const END_BYTES: usize = 22;
const MAX_COMMENT: usize = 65_535;
const MAX_MEMBERS: u64 = 200_000;

/// A zip file's members by name.
pub(super) type Members = BTreeMap<String, Range<usize>>;

struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn at<const N: usize>(&self, at: usize) -> Result<[u8; N], String> {
        let end = at.checked_add(N).ok_or("an offset overflows")?;
        let slice = self.0.get(at..end).ok_or_else(|| format!("it ends at byte {}, {end} needed", self.0.len()))?;
        Ok(slice.try_into().expect("the slice has N bytes"))
    }

    fn u16(&self, at: usize) -> Result<usize, String> {
        Ok(usize::from(u16::from_le_bytes(self.at(at)?)))
    }

    fn u32(&self, at: usize) -> Result<u64, String> {
        Ok(u64::from(u32::from_le_bytes(self.at(at)?)))
    }

    fn u64(&self, at: usize) -> Result<u64, String> {
        Ok(u64::from_le_bytes(self.at(at)?))
    }

    fn starts(&self, at: usize, signature: [u8; 4]) -> bool {
        self.at::<4>(at).is_ok_and(|found| found == signature)
    }
}

fn place(value: u64) -> Result<usize, String> {
    usize::try_from(value).map_err(|_| format!("the offset {value} is too large"))
}

/// Lists the members.
pub(super) fn members(file: &[u8]) -> Result<Members, String> {
    let bytes = Bytes(file);
    let (count, mut at) = directory(&bytes)?;
    if count > MAX_MEMBERS {
        return Err(format!("it claims {count} members, at most {MAX_MEMBERS} are read"));
    }
    let mut members = Members::new();
    for _ in 0..count {
        if !bytes.starts(at, ENTRY) {
            return Err(format!("its directory is broken at byte {at}"));
        }
        let (name_len, extra_len, comment_len) = (bytes.u16(at + 28)?, bytes.u16(at + 30)?, bytes.u16(at + 32)?);
        let name = file.get(at + 46..at + 46 + name_len).ok_or("its directory is cut off")?;
        let name = String::from_utf8_lossy(name).into_owned();
        let (flags, method) = (bytes.u16(at + 8)?, bytes.u16(at + 10)?);
        if method != 0 || flags & 1 != 0 {
            return Err(format!("member {name:?} is compressed or encrypted, PyTorch stores members as they are"));
        }
        let extra = at + 46 + name_len;
        let (size, start) = sizes(&bytes, at, extra..extra + extra_len)?;
        let range = data(&bytes, place(start)?, place(size)?).map_err(|reason| format!("member {name:?}: {reason}"))?;
        members.insert(name, range);
        at = extra + extra_len + comment_len;
    }
    Ok(members)
}

/// Returns the number of members and where their directory begins.
fn directory(bytes: &Bytes<'_>) -> Result<(u64, usize), String> {
    let length = bytes.0.len();
    let last = length.checked_sub(END_BYTES).ok_or("it is shorter than an empty archive")?;
    let first = last.saturating_sub(MAX_COMMENT);
    let end = (first..=last).rev().find(|at| bytes.starts(*at, END));
    let end = end.ok_or("it has no end of directory; the file is cut off or not a zip archive")?;
    let (count, start) = (bytes.u16(end + 10)? as u64, bytes.u32(end + 16)?);
    match end.checked_sub(20).filter(|at| bytes.starts(*at, LOCATOR_64)) {
        Some(locator) => {
            let at = place(bytes.u64(locator + 8)?)?;
            if !bytes.starts(at, END_64) {
                return Err("its 64-bit end of directory is broken".to_owned());
            }
            Ok((bytes.u64(at + 32)?, place(bytes.u64(at + 48)?)?))
        }
        None => Ok((count, place(start)?)),
    }
}

/// Returns size and start of a member, from the 64-bit extra field where the entry says so.
fn sizes(bytes: &Bytes<'_>, at: usize, extra: Range<usize>) -> Result<(u64, u64), String> {
    let (packed, unpacked, start) = (bytes.u32(at + 20)?, bytes.u32(at + 24)?, bytes.u32(at + 42)?);
    let wide = |value: u64| value == u64::from(u32::MAX);
    let mut fields = [unpacked, packed, start];
    let mut field = extra.start;
    while field + 4 <= extra.end {
        let (id, length) = (bytes.u16(field)?, bytes.u16(field + 2)?);
        if id == 1 {
            let mut value = field + 4;
            for slot in fields.iter_mut().filter(|slot| wide(**slot)) {
                *slot = bytes.u64(value)?;
                value += 8;
            }
        }
        field += 4 + length;
    }
    if fields[0] != fields[1] {
        return Err(format!("a stored member has {} bytes packed and {} unpacked", fields[1], fields[0]));
    }
    Ok((fields[0], fields[2]))
}

/// Returns the bytes of the member whose own header is at `start`.
fn data(bytes: &Bytes<'_>, start: usize, size: usize) -> Result<Range<usize>, String> {
    if !bytes.starts(start, MEMBER) {
        return Err(format!("no header at byte {start}"));
    }
    let begin = start + 30 + bytes.u16(start + 26)? + bytes.u16(start + 28)?;
    let end = begin.checked_add(size).filter(|end| *end <= bytes.0.len());
    let end = end.ok_or_else(|| format!("it claims {size} bytes from {begin} of {}", bytes.0.len()))?;
    Ok(begin..end)
}
