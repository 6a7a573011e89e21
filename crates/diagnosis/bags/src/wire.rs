//! The bytes of a message as numbers in their order, by either way of writing.
//!
//! CDR has four bytes of framing, from behind which alignment counts; its second version aligns eight-byte values to four. No length
//! is believed before that many bytes are there.

use crate::definition::{Count, Held, Member, Number, Schema, Wire};

/// Bytes of CDR's framing.
const FRAMING: usize = 4;

/// A reader of one message.
pub(crate) struct Bytes<'a> {
    data: &'a [u8],
    at: usize,
    /// Largest alignment.
    alignment: usize,
    big: bool,
}

impl<'a> Bytes<'a> {
    /// Opens a message.
    pub(crate) fn new(data: &'a [u8], wire: Wire) -> Result<Self, String> {
        if wire == Wire::Ros1 {
            return Ok(Self { data, at: 0, alignment: 1, big: false });
        }
        let (framing, data) = data.split_at_checked(FRAMING).ok_or("shorter than the framing of CDR")?;
        if framing == [0x28, 0xb5, 0x2f, 0xfd] {
            return Err("compressed by zstd (`ros2 bag convert` writes a plain bag)".to_owned());
        }
        let (alignment, big) = match framing[1] {
            0 => (8, true),
            1 => (8, false),
            6 => (4, true),
            7 => (4, false),
            other => return Err(format!("CDR of kind {other}; plain CDR (0, 1, 6, 7) is read")),
        };
        Ok(Self { data, at: 0, alignment, big })
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.data.len());
        let end = end.ok_or_else(|| format!("breaks off at byte {}, {count} more are due", self.at))?;
        let taken = &self.data[self.at..end];
        self.at = end;
        Ok(taken)
    }

    fn align(&mut self, size: usize) -> Result<(), String> {
        let over = self.at % size.min(self.alignment);
        if over == 0 { Ok(()) } else { self.take(size.min(self.alignment) - over).map(|_| ()) }
    }

    /// Reads a number.
    pub(crate) fn number(&mut self, kind: Number) -> Result<f64, String> {
        self.align(kind.size())?;
        let bytes = self.take(kind.size())?;
        let mut low = [0; 8];
        for (place, byte) in low.iter_mut().zip(0..bytes.len()) {
            *place = bytes[if self.big { bytes.len() - 1 - byte } else { byte }];
        }
        let bits = u64::from_le_bytes(low);
        Ok(match kind {
            Number::Bool => f64::from(u8::from(bits != 0)),
            Number::U8 | Number::U16 | Number::U32 | Number::U64 => bits as f64,
            Number::I8 => f64::from(bits as u8 as i8),
            Number::I16 => f64::from(bits as u16 as i16),
            Number::I32 => f64::from(bits as u32 as i32),
            Number::I64 => bits as i64 as f64,
            Number::F32 => f64::from(f32::from_bits(bits as u32)),
            Number::F64 => f64::from_bits(bits),
        })
    }

    /// Reads how many of a field follow.
    pub(crate) fn count(&mut self, count: Count) -> Result<usize, String> {
        match count {
            Count::One => Ok(1),
            Count::Fixed(count) => Ok(count),
            Count::Many => self.number(Number::U32).map(|count| count as usize),
        }
    }

    /// Passes over one value of a field.
    pub(crate) fn skip_one(&mut self, schema: &Schema, held: &Held) -> Result<(), String> {
        match held {
            Held::Number(kind) => {
                self.align(kind.size())?;
                self.take(kind.size()).map(|_| ())
            }
            Held::Text => {
                let length = self.number(Number::U32)? as usize;
                self.take(length).map(|_| ())
            }
            Held::WideText => Err("holds text of wide characters before the wanted field".to_owned()),
            Held::Structure(place) => schema.structures[*place].members.iter().try_for_each(|m| self.skip(schema, m)),
        }
    }

    /// Passes over a field.
    pub(crate) fn skip(&mut self, schema: &Schema, member: &Member) -> Result<(), String> {
        let count = self.count(member.count)?;
        match &member.held {
            Held::Number(kind) if count > 0 => {
                self.align(kind.size())?;
                self.take(count.saturating_mul(kind.size())).map(|_| ())
            }
            Held::Structure(place) if schema.structures[*place].hollow => Ok(()),
            // every other value takes a byte at least
            held => {
                self.fits(count)?;
                (0..count).try_for_each(|_| self.skip_one(schema, held))
            }
        }
    }

    /// Returns how many bytes are left.
    pub(crate) fn left(&self) -> usize {
        self.data.len() - self.at
    }

    /// Refuses more values than there are bytes.
    pub(crate) fn fits(&self, count: usize) -> Result<(), String> {
        let left = self.left();
        if count <= left {
            Ok(())
        } else {
            Err(format!("says {count} values at byte {}, {left} bytes are left", self.at))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads a byte, a number of eight bytes and one of two.
    fn read(message: &[u8], wire: Wire) -> Result<[f64; 3], String> {
        let mut bytes = Bytes::new(message, wire)?;
        let numbers = [bytes.number(Number::U8)?, bytes.number(Number::F64)?, bytes.number(Number::I16)?];
        assert_eq!(bytes.left(), 0);
        Ok(numbers)
    }

    #[test]
    fn alignment_and_order_of_bytes_are_those_of_each_writing() {
        let half = 0.5_f64;
        let known = Ok([7.0, 0.5, -2.0]);
        let message = |framing: &[u8], pad: usize, big: bool| {
            let number = if big { half.to_be_bytes() } else { half.to_le_bytes() };
            let short = if big { (-2_i16).to_be_bytes() } else { (-2_i16).to_le_bytes() };
            [framing, &[7], &vec![0; pad], &number, &short].concat()
        };
        assert_eq!(read(&message(&[], 0, false), Wire::Ros1), known);
        assert_eq!(read(&message(&[0, 1, 0, 0], 7, false), Wire::Cdr), known);
        assert_eq!(read(&message(&[0, 0, 0, 0], 7, true), Wire::Cdr), known);
        assert_eq!(read(&message(&[0, 7, 0, 0], 3, false), Wire::Cdr), known, "the second version aligns to four");
        assert_eq!(read(&message(&[0, 6, 0, 0], 3, true), Wire::Cdr), known);
        for (framing, hint) in [([0, 3, 0, 0], "kind 3"), ([0x28, 0xb5, 0x2f, 0xfd], "zstd")] {
            assert!(read(&message(&framing, 7, false), Wire::Cdr).expect_err("not plain").contains(hint));
        }
        assert!(read(&[0, 1, 0, 0, 7, 0], Wire::Cdr).expect_err("cut").contains("breaks off"));
    }

    #[test]
    fn a_count_that_the_bytes_cannot_hold_is_refused_at_once() {
        let schema = Schema::parse("p/A", "B[] many\nfloat64[] numbers\n===\nMSG: p/B\nstring s", Wire::Ros1);
        let schema = schema.expect("a definition");
        let message = u32::MAX.to_le_bytes();
        for member in &schema.structures[0].members {
            let mut bytes = Bytes::new(&message, Wire::Ros1).expect("four bytes");
            assert!(bytes.skip(&schema, member).is_err(), "{member:?}");
        }
    }
}
