//! The hashed prompt: a deterministic embedding of the words of a prompt, in place of a language model.
//!
//! Each word of letters and digits, in lower case, draws a slot and a normal vector keyed by the word alone; words of
//! one slot add up. Order does not matter, repeated words count once.

use std::collections::BTreeSet;

use ds_nn::Array;
use ds_space::{Digest, Draws};

/// At most this many bytes of a prompt are read.
pub const MAX_PROMPT_BYTES: usize = 4_096;

/// Returns what is read of a prompt.
pub(crate) fn bounded(prompt: &str) -> &str {
    let end = (0..=prompt.len().min(MAX_PROMPT_BYTES)).rev().find(|end| prompt.is_char_boundary(*end)).unwrap_or(0);
    &prompt[..end]
}

/// Embeds a prompt as [1, tokens, width].
#[must_use]
pub fn hashed(prompt: &str, tokens: usize, width: usize) -> Array {
    let mut array = Array::zeros(&[1, tokens, width]);
    if tokens == 0 || width == 0 {
        return array;
    }
    let lower = bounded(prompt).to_lowercase();
    let words: BTreeSet<&str> = lower.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
    for word in words {
        let draws = Draws::new(&Digest::of(word.as_bytes()), "prompt-word", &[]);
        let slot = draws.below(0, tokens as u64) as usize;
        let values = &mut array.values_mut()[slot * width..(slot + 1) * width];
        for (index, value) in (1..).zip(values) {
            #[expect(clippy::cast_possible_truncation, reason = "embeddings are single precision")]
            let draw = draws.normal(index) as f32;
            *value += draw;
        }
    }
    array
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_set_of_words_counts() {
        let embed = |prompt: &str| hashed(prompt, 4, 16);
        assert_eq!(embed("Wet road, at night"), embed("at night: wet, wet ROAD"));
        assert_ne!(embed("wet road"), embed("dry road"));
        assert_eq!(embed(""), Array::zeros(&[1, 4, 16]));
        assert!(embed(&"é".repeat(5_000)).is_finite());
    }
}
