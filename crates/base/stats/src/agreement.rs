//! How far two judges agree beyond chance.

/// Returns Cohen's kappa of two judges who said yes or no of the same things: 1 where they always agree, 0 where no more
/// than by chance; nothing for no things, or where chance alone explains everything.
#[must_use]
pub fn kappa(said: &[(bool, bool)]) -> Option<f64> {
    let share = |holds: fn(&(bool, bool)) -> bool| {
        said.iter().filter(|pair| holds(pair)).count() as f64 / said.len().max(1) as f64
    };
    let (agreed, first, second) = (share(|(a, b)| a == b), share(|(a, _)| *a), share(|(_, b)| *b));
    let by_chance = first * second + (1.0 - first) * (1.0 - second);
    (!said.is_empty() && by_chance < 1.0).then(|| (agreed - by_chance) / (1.0 - by_chance))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agreement_beyond_chance_by_table() {
        let said = |counts: [usize; 4]| -> Vec<(bool, bool)> {
            let pairs = [(true, true), (true, false), (false, true), (false, false)];
            pairs.into_iter().zip(counts).flat_map(|(pair, count)| std::iter::repeat_n(pair, count)).collect()
        };
        for (counts, expected) in [
            // Agreed 0.7, by chance 0.5 · 0.6 + 0.5 · 0.4 = 0.5.
            ([20, 5, 10, 15], Some(0.4)),
            ([3, 0, 0, 2], Some(1.0)),
            ([0, 2, 2, 0], Some(-1.0)),
            ([4, 0, 0, 0], None),
            ([0, 0, 0, 0], None),
        ] {
            match (kappa(&said(counts)), expected) {
                (Some(found), Some(expected)) => assert!((found - expected).abs() < 1e-12, "{counts:?}: {found}"),
                (found, expected) => assert_eq!(found, expected, "{counts:?}"),
            }
        }
    }
}
