//! Tokens of a prompt by a unigram model of sentencepiece (`spiece.model`), the tokeniser that UMT5 is published with.
//!
//! The model file is a protobuf of pieces with scores and a compiled table of characters. A text is normalised by the
//! table's longest matches, spaces become `▁`, and the pieces of highest total score are taken; what no piece covers
//! becomes its bytes, if the model has those, or the unknown token. Every length is checked against the file.

use std::collections::HashMap;
use std::path::Path;

use ds_space::Digest;

/// The longest accepted model, in bytes.
const MAX_FILE_BYTES: u64 = 64 << 20;
/// What the unknown token costs beyond the worst piece.
const UNKNOWN_PENALTY: f32 = 10.0;
const SPACE: &str = "\u{2581}";

/// Says why a model is refused.
#[derive(Debug, thiserror::Error)]
pub enum TokeniserError {
    /// Reading failed.
    #[error("tokeniser model cannot be read: {path:?}")]
    Io {
        /// The file.
        path: String,
        /// The system's answer.
        #[source]
        source: std::io::Error,
    },
    /// The file is broken or of another kind.
    #[error("tokeniser model: {reason}")]
    Broken {
        /// What is wrong.
        reason: String,
    },
}

fn broken<T>(reason: impl Into<String>) -> Result<T, TokeniserError> {
    Err(TokeniserError::Broken { reason: reason.into() })
}

/// One field of a protobuf message.
enum Field<'a> {
    Number(u64),
    Bytes(&'a [u8]),
    Four([u8; 4]),
}

/// Splits a message into numbered fields.
fn fields(mut bytes: &[u8]) -> Result<Vec<(u64, Field<'_>)>, TokeniserError> {
    fn number(bytes: &mut &[u8]) -> Result<u64, TokeniserError> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let Some((first, rest)) = bytes.split_first() else { return broken("it is cut off") };
            *bytes = rest;
            value |= u64::from(first & 0x7f) << shift;
            if first & 0x80 == 0 {
                return Ok(value);
            }
        }
        broken("a number is too long")
    }
    fn take<'a>(bytes: &mut &'a [u8], count: u64) -> Result<&'a [u8], TokeniserError> {
        match usize::try_from(count).ok().filter(|count| *count <= bytes.len()) {
            Some(count) => {
                let (taken, rest) = bytes.split_at(count);
                *bytes = rest;
                Ok(taken)
            }
            None => broken(format!("a field claims {count} bytes of {}", bytes.len())),
        }
    }
    let mut found = Vec::new();
    while !bytes.is_empty() {
        let key = number(&mut bytes)?;
        let field = match key & 7 {
            0 => Field::Number(number(&mut bytes)?),
            1 => Field::Bytes(take(&mut bytes, 8)?),
            2 => {
                let count = number(&mut bytes)?;
                Field::Bytes(take(&mut bytes, count)?)
            }
            5 => Field::Four(take(&mut bytes, 4)?.try_into().expect("four bytes")),
            kind => return broken(format!("a field has the unknown kind {kind}")),
        };
        found.push((key >> 3, field));
    }
    Ok(found)
}

/// How characters are replaced: a double array of keys, and the texts that it points to.
#[derive(Default)]
struct Table {
    units: Vec<u32>,
    texts: Vec<u8>,
}

impl Table {
    fn parse(bytes: &[u8]) -> Result<Self, TokeniserError> {
        let Some((length, rest)) = bytes.split_first_chunk::<4>() else { return Ok(Self::default()) };
        let length = u32::from_le_bytes(*length) as usize;
        if length > rest.len() || !length.is_multiple_of(4) {
            return broken(format!("its table of characters claims {length} bytes of {}", rest.len()));
        }
        let (units, texts) = rest.split_at(length);
        let units =
            units.chunks_exact(4).map(|unit| u32::from_le_bytes([unit[0], unit[1], unit[2], unit[3]])).collect();
        Ok(Self { units, texts: texts.to_vec() })
    }

    /// Returns the replacement of the longest key that the text begins with, and the key's length.
    fn longest(&self, text: &[u8]) -> Option<(&[u8], usize)> {
        let offset = |unit: u32| ((unit >> 10) << ((unit & (1 << 9)) >> 6)) as usize;
        let mut at = offset(*self.units.first()?);
        let mut found = None;
        for (index, byte) in text.iter().enumerate() {
            at ^= usize::from(*byte);
            let Some(unit) = self.units.get(at).filter(|unit| **unit & ((1 << 31) | 0xff) == u32::from(*byte)) else {
                break;
            };
            at ^= offset(*unit);
            if (unit >> 8) & 1 == 1 {
                let value = self.units.get(at)? & !(1 << 31);
                found = Some((value as usize, index + 1));
            }
        }
        let (start, length) = found?;
        let text = self.texts.get(start..)?;
        let end = text.iter().position(|byte| *byte == 0)?;
        Some((&text[..end], length))
    }
}

/// A unigram model.
pub struct Tokeniser {
    pieces: HashMap<Vec<u8>, (u32, f32)>,
    longest: usize,
    unknown: u32,
    unknown_score: f32,
    bytes: Option<Vec<u32>>,
    table: Table,
    dummy_prefix: bool,
    end: Option<u32>,
    size: u32,
    digest: Digest,
}

impl Tokeniser {
    /// Reads a model file.
    ///
    /// # Errors
    /// If it cannot be read, is broken, or holds no unigram model.
    pub fn load(path: &Path) -> Result<Self, TokeniserError> {
        let io = |source| TokeniserError::Io { path: path.display().to_string(), source };
        let file = std::fs::File::open(path).map_err(io)?;
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut std::io::Read::take(file, MAX_FILE_BYTES), &mut bytes).map_err(io)?;
        Self::parse(&bytes)
    }

    /// Reads a model.
    ///
    /// # Errors
    /// If it is broken or no unigram model.
    pub fn parse(model: &[u8]) -> Result<Self, TokeniserError> {
        let mut made = Self {
            pieces: HashMap::new(),
            longest: 0,
            unknown: 0,
            unknown_score: 0.0,
            bytes: None,
            table: Table::default(),
            dummy_prefix: true,
            end: None,
            size: 0,
            digest: Digest::of(model),
        };
        let (mut byte_tokens, mut worst, mut id) = (Vec::new(), f32::INFINITY, 0);
        for (field, value) in fields(model)? {
            match (field, value) {
                (1, Field::Bytes(piece)) => {
                    made.add_piece(piece, id, &mut worst, &mut byte_tokens)?;
                    id += 1;
                }
                (2, Field::Bytes(trainer)) => {
                    for (field, value) in fields(trainer)? {
                        if let (3, Field::Number(kind)) = (field, value)
                            && kind != 1
                        {
                            return broken(format!("it is of kind {kind}, 1 (unigram) expected"));
                        }
                    }
                }
                (3, Field::Bytes(normaliser)) => made.set_normaliser(normaliser)?,
                _ => {}
            }
        }
        if made.pieces.is_empty() {
            return broken("it holds no pieces");
        }
        made.unknown_score = worst - UNKNOWN_PENALTY;
        made.bytes = (byte_tokens.len() == 256).then_some(byte_tokens);
        made.size = id;
        Ok(made)
    }

    fn add_piece(
        &mut self,
        piece: &[u8],
        id: u32,
        worst: &mut f32,
        bytes: &mut Vec<u32>,
    ) -> Result<(), TokeniserError> {
        let (mut text, mut score, mut kind) = (&[][..], 0.0, 1);
        for (field, value) in fields(piece)? {
            match (field, value) {
                (1, Field::Bytes(value)) => text = value,
                (2, Field::Four(value)) => score = f32::from_le_bytes(value),
                (3, Field::Number(value)) => kind = value,
                _ => {}
            }
        }
        match kind {
            // A plain piece, or one that the user has put in.
            1 | 4 => {
                self.longest = self.longest.max(text.len());
                *worst = worst.min(score);
                self.pieces.insert(text.to_vec(), (id, score));
            }
            2 => self.unknown = id,
            3 if text == b"</s>" => self.end = Some(id),
            6 => bytes.push(id),
            _ => {}
        }
        Ok(())
    }

    fn set_normaliser(&mut self, normaliser: &[u8]) -> Result<(), TokeniserError> {
        for (field, value) in fields(normaliser)? {
            match (field, value) {
                (2, Field::Bytes(table)) => self.table = Table::parse(table)?,
                (3, Field::Number(value)) => self.dummy_prefix = value != 0,
                (4 | 5, Field::Number(0)) => return broken("it keeps spaces as they are, which is not read here"),
                _ => {}
            }
        }
        Ok(())
    }

    /// Returns the number of tokens, special ones included; every token is below it.
    #[must_use]
    pub fn size(&self) -> u32 {
        self.size
    }

    /// Returns the digest of the model file.
    #[must_use]
    pub fn digest(&self) -> Digest {
        self.digest
    }

    /// Returns the tokens of a text, at most `limit` with the end token last, as UMT5 takes them. Runs of white space
    /// count as one space.
    #[must_use]
    pub fn tokens(&self, text: &str, limit: usize) -> Vec<u32> {
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        let mut tokens = self.encode(&text);
        tokens.truncate(limit.saturating_sub(usize::from(self.end.is_some())));
        tokens.extend(self.end);
        tokens.truncate(limit);
        tokens
    }

    /// Returns the tokens of a text without an end token.
    #[must_use]
    pub fn encode(&self, text: &str) -> Vec<u32> {
        let text = self.normalised(text);
        let bytes = text.as_bytes();
        // For each position: the best score of a path to it, where its last piece begins, and that piece.
        let mut best: Vec<Option<(f32, usize, u32)>> = vec![None; bytes.len() + 1];
        best[0] = Some((0.0, 0, self.unknown));
        for (start, character) in text.char_indices() {
            let Some((score, ..)) = best[start] else { continue };
            let mut offer = |end: usize, gain: f32, token: u32| {
                if best[end].is_none_or(|(found, ..)| score + gain > found) {
                    best[end] = Some((score + gain, start, token));
                }
            };
            let one = start + character.len_utf8();
            let mut covered = false;
            for end in (one..=bytes.len().min(start + self.longest)).filter(|end| text.is_char_boundary(*end)) {
                if let Some((token, gain)) = self.pieces.get(&bytes[start..end]) {
                    covered |= end == one;
                    offer(end, *gain, *token);
                }
            }
            if !covered {
                offer(one, self.unknown_score, self.unknown);
            }
        }
        self.path(bytes, &best)
    }

    /// Walks the best path back; what is unknown becomes bytes or one token for a run of it.
    fn path(&self, bytes: &[u8], best: &[Option<(f32, usize, u32)>]) -> Vec<u32> {
        let mut pieces = Vec::new();
        let mut at = bytes.len();
        while let Some((_, start, token)) = best[at].filter(|_| at > 0) {
            pieces.push((token, start..at));
            at = start;
        }
        let mut tokens: Vec<u32> = Vec::new();
        let mut after_unknown = false;
        for (token, range) in pieces.into_iter().rev() {
            let unknown = token == self.unknown;
            match &self.bytes {
                Some(table) if unknown => tokens.extend(bytes[range].iter().map(|byte| table[usize::from(*byte)])),
                _ if unknown && after_unknown => {}
                _ => tokens.push(token),
            }
            after_unknown = unknown;
        }
        tokens
    }

    /// Replaces characters by the table, spaces by `▁`, drops spaces at both ends and repeated ones.
    fn normalised(&self, text: &str) -> String {
        let mut made = String::new();
        let mut after_space = true;
        let mut at = 0;
        while at < text.len() {
            let replaced = self.table.longest(&text.as_bytes()[at..]);
            let replaced = replaced.filter(|(_, length)| text.is_char_boundary(at + length));
            let part = match replaced {
                Some((part, length)) => {
                    at += length;
                    String::from_utf8_lossy(part).into_owned()
                }
                None => {
                    let character = text[at..].chars().next().map(String::from).unwrap_or_default();
                    at += character.len().max(1);
                    character
                }
            };
            let part = if after_space { part.trim_start_matches(' ') } else { &part };
            if !part.is_empty() {
                after_space = part.ends_with(' ');
                made.push_str(&part.replace(' ', SPACE));
            }
        }
        let made = made.trim_end_matches(SPACE);
        if made.is_empty() {
            return String::new();
        }
        if self.dummy_prefix { format!("{SPACE}{made}") } else { made.to_owned() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(number: u8, bytes: &[u8]) -> Vec<u8> {
        [&[number << 3 | 2, bytes.len() as u8], bytes].concat()
    }

    fn piece(text: &str, score: f32, kind: u8) -> Vec<u8> {
        let score = [&[2 << 3 | 5], &score.to_le_bytes()[..]].concat();
        field(1, &[field(1, text.as_bytes()), score, vec![3 << 3, kind]].concat())
    }

    fn model() -> Vec<u8> {
        let pieces = [("<pad>", 0.0, 3), ("</s>", 0.0, 3), ("<unk>", 0.0, 2), ("▁wet", -2.0, 1), ("▁", -3.0, 1)];
        let more = [("w", -5.0, 1), ("et", -4.0, 1), ("▁ro", -3.0, 1), ("ad", -3.0, 1), ("▁road", -5.5, 1)];
        pieces.into_iter().chain(more).flat_map(|(text, score, kind)| piece(text, score, kind)).collect()
    }

    #[test]
    fn the_path_of_the_highest_score_is_taken() {
        let tokeniser = Tokeniser::parse(&model()).expect("a model");
        assert_eq!(tokeniser.tokens("  wet \n road ", 8), [3, 9, 1]);
        assert_eq!(tokeniser.tokens("wet road", 2), [3, 1]);
        assert_eq!(tokeniser.tokens("wxyz", 8), [4, 5, 2, 1]);
        assert_eq!(tokeniser.tokens("", 8), [1]);
    }

    #[test]
    fn broken_models_are_refused() {
        let check = |bytes: &[u8], expected: &str| {
            let error = Tokeniser::parse(bytes).err().expect(expected).to_string();
            assert!(error.contains(expected), "{error}");
        };
        check(&[], "no pieces");
        check(&model()[..model().len() - 3], "claims");
        check(&[0x0a, 0xff, 0xff, 0xff, 0xff, 0x0f], "claims 4294967295 bytes");
        check(&[model(), field(2, &[3 << 3, 2])].concat(), "of kind 2");
        check(&[model(), field(3, &field(2, &[0xff, 0xff, 0, 0, 1]))].concat(), "table of characters");
        check(&[0xff; 12], "too long");
    }
}
