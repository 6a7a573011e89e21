//! One clip as the sequence that the network sees: states, conditions, times, and who attends to whom.

use std::ops::Range;

use ds_nn::step::Group;

/// A sequence of frames.
pub(super) struct Sequence<'a> {
    /// The state of each frame, [frames, tokens, 4, z].
    pub(super) noisy: Vec<f32>,
    /// Space-to-depth layouts by position, [positions, tokens, 4, control inputs].
    pub(super) layouts: &'a [f32],
    /// Factor of the control.
    pub(super) layout_on: f32,
    /// The start latent, [tokens, 4, z].
    pub(super) start: Vec<f32>,
    /// Prompt tokens, [text_len, text_dim].
    pub(super) text: Vec<f32>,
    /// The timestep of each frame.
    pub(super) times: Vec<f32>,
    /// Where each frame stands in time, which is also whose layout it shows.
    pub(super) positions: Vec<usize>,
    /// Who attends to whom, in frames; queries follow one another.
    pub(super) groups: Vec<Group>,
    /// Whether gradients stop at keys and values of other groups.
    pub(super) detached: bool,
    /// The first frame that a gradient reaches; it reaches all after it.
    pub(super) live: usize,
}

/// A run of rows at one time.
#[derive(Clone)]
pub(super) struct Run {
    pub(super) rows: Range<usize>,
    /// Index into the distinct times.
    pub(super) time: usize,
}

/// A sink that is read as if it stood later.
pub(super) struct Moved {
    pub(super) frames: usize,
    pub(super) by: usize,
}

/// Rows that attend to the same keys.
pub(super) struct Link {
    pub(super) queries: Range<usize>,
    /// Runs of rows that are seen, in order.
    pub(super) pieces: Vec<Range<usize>>,
    /// Whether gradients reach each piece.
    pub(super) reached: Vec<bool>,
    /// Which moved copy stands for the keys of the first piece.
    pub(super) moved: Option<usize>,
}

impl Sequence<'_> {
    /// Returns the distinct times in the order of their first frame, and the runs of rows that share one.
    pub(super) fn runs(&self, tokens: usize) -> (Vec<f32>, Vec<Run>) {
        let (mut times, mut runs): (Vec<f32>, Vec<Run>) = (Vec::new(), Vec::new());
        for (frame, label) in self.times.iter().enumerate() {
            let time = times.iter().position(|known| known.to_bits() == label.to_bits()).unwrap_or_else(|| {
                times.push(*label);
                times.len() - 1
            });
            let rows = frame * tokens..(frame + 1) * tokens;
            match runs.last_mut().filter(|run| run.time == time) {
                Some(run) => run.rows.end = rows.end,
                None => runs.push(Run { rows, time }),
            }
        }
        (times, runs)
    }

    /// Returns the groups in rows, and the moved sinks that they name.
    pub(super) fn links(&self, tokens: usize) -> (Vec<Link>, Vec<Moved>) {
        let mut moved: Vec<Moved> = Vec::new();
        let rows = |frames: &Range<usize>| frames.start * tokens..frames.end * tokens;
        let mut link = |group: &Group| {
            let Group { queries, sink, evicted, past, own } = group;
            let shifted = (*evicted > 0 && *sink > 0).then(|| {
                let known = moved.iter().position(|moved| (moved.frames, moved.by) == (*sink, *evicted));
                known.unwrap_or_else(|| {
                    moved.push(Moved { frames: *sink, by: *evicted });
                    moved.len() - 1
                })
            });
            let (mut pieces, mut reached): (Vec<Range<usize>>, Vec<bool>) = (Vec::new(), Vec::new());
            for (frames, cached) in [(&(0..*sink), true), (past, true), (own, false)] {
                if frames.is_empty() {
                    continue;
                }
                let (rows, reach) = (rows(frames), !(self.detached && cached));
                let joins = pieces.last().is_some_and(|last| last.end == rows.start)
                    && reached.last() == Some(&reach)
                    && !(pieces.len() == 1 && shifted.is_some());
                if joins {
                    pieces.last_mut().expect("there is one to join").end = rows.end;
                } else {
                    pieces.push(rows);
                    reached.push(reach);
                }
            }
            Link { queries: rows(queries), pieces, reached, moved: shifted }
        };
        let links = self.groups.iter().map(&mut link).collect();
        (links, moved)
    }
}

/// Takes ranges that follow one another out of a slice of rows.
pub(super) fn carve<'a>(mut rows: &'a mut [f32], width: usize, ranges: &[Range<usize>]) -> Vec<&'a mut [f32]> {
    let mut at = 0;
    let mut parts = Vec::with_capacity(ranges.len());
    for range in ranges {
        let (part, rest) = rows.split_at_mut((range.end - at) * width);
        parts.push(&mut part[(range.start - at) * width..]);
        (rows, at) = (rest, range.end);
    }
    parts
}
