//! From what a policy attends to, [tokens, channels], to one vector per frame.

/// Returns the mean over tokens: FDπ's own pooling, fixed before any source was measured.
#[must_use]
pub fn mean_pooled(context: &[f32], channels: usize) -> Vec<f64> {
    let mut sum = vec![0.0; channels];
    let mut count = 0.0;
    for token in context.chunks_exact(channels) {
        sum.iter_mut().zip(token).for_each(|(sum, value)| *sum += f64::from(*value));
        count += 1.0;
    }
    sum.iter_mut().for_each(|sum| *sum /= f64::max(count, 1.0));
    sum
}

/// Returns the means of four groups of tokens, one behind the other: the quarters of a grid of [rows, columns], or runs
/// of a list that has no grid. Four times the features, so it ranks sources and is no value.
#[must_use]
pub fn placed(context: &[f32], channels: usize, grid: Option<[usize; 2]>) -> Vec<f64> {
    let tokens = context.len() / channels.max(1);
    let group = |token: usize| match grid {
        Some([rows, columns]) => token / columns * 2 / rows * 2 + token % columns * 2 / columns,
        None => token * 4 / tokens,
    };
    let mut groups: [Vec<f32>; 4] = Default::default();
    for (token, values) in context.chunks_exact(channels).enumerate() {
        groups[group(token)].extend_from_slice(values);
    }
    groups.iter().flat_map(|group| mean_pooled(group, channels)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_by_hand() {
        let context: Vec<f32> = (0..16).map(|token| token as f32).flat_map(|v| [v, -v]).collect();
        assert_eq!(mean_pooled(&context, 2), [7.5, -7.5]);
        let quarters = placed(&context, 2, Some([4, 4]));
        assert_eq!(quarters, [2.5, -2.5, 4.5, -4.5, 10.5, -10.5, 12.5, -12.5]);
        assert_eq!(placed(&context, 2, None), [1.5, -1.5, 5.5, -5.5, 9.5, -9.5, 13.5, -13.5]);
    }
}
