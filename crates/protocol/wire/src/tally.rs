//! Counts the elements of lists in encoded bytes, so that a small message cannot ask for a giant allocation.
//!
//! An empty element takes two bytes on the wire and a hundred or more in memory; the count is therefore known before
//! anything is decoded. Bytes that are not protobuf are left to the decoder to refuse; groups are refused here.

use prost::encoding::{WireType, decode_key, decode_varint};

use crate::error::WireError;

/// The most elements at a path of field numbers, over the whole message.
pub(crate) struct Limit {
    /// Field numbers from the message down to the list.
    pub(crate) path: &'static [u32],
    /// The list's name in errors.
    pub(crate) field: &'static str,
    /// The most elements.
    pub(crate) most: usize,
}

/// Refuses a message with a list that is too long.
pub(crate) fn check(message: &'static str, bytes: &[u8], limits: &[Limit]) -> Result<(), WireError> {
    for limit in limits {
        let mut found = 0;
        count(bytes, limit.path, limit.most, &mut found)
            .map_err(|problem| WireError::Decode { message, problem: problem.to_owned() })?;
        if found > limit.most {
            return Err(WireError::TooMany { message, field: limit.field, most: limit.most });
        }
    }
    Ok(())
}

/// Adds the number of elements at a path; stops early above `most` and where the bytes make no sense.
fn count(mut bytes: &[u8], path: &[u32], most: usize, found: &mut usize) -> Result<(), &'static str> {
    let Some((wanted, rest)) = path.split_first() else { return Ok(()) };
    while !bytes.is_empty() && *found <= most {
        let Ok((field, wire_type)) = decode_key(&mut bytes) else { return Ok(()) };
        let length = match wire_type {
            WireType::Varint => {
                if decode_varint(&mut bytes).is_err() {
                    return Ok(());
                }
                0
            }
            WireType::ThirtyTwoBit => 4,
            WireType::SixtyFourBit => 8,
            WireType::LengthDelimited => {
                let Ok(length) = decode_varint(&mut bytes) else { return Ok(()) };
                usize::try_from(length).unwrap_or(usize::MAX)
            }
            WireType::StartGroup | WireType::EndGroup => return Err("groups are not accepted"),
        };
        let Some((value, after)) = bytes.split_at_checked(length) else { return Ok(()) };
        if field == *wanted && wire_type == WireType::LengthDelimited {
            if rest.is_empty() {
                *found += 1;
            } else {
                count(value, rest, most, found)?;
            }
        }
        bytes = after;
    }
    Ok(())
}
