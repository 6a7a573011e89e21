//! How distances grow along a drive: FDπ over the ten frames up to each mark, of the same drives, equal n at every mark.
//!
//! Each mark is compared with the real frames of the same moments, in units of their variance. For each pair of sources
//! under `ratios`, (without, with): what share of the rise from the first mark to the last the second one takes away.

use ds_fidelity::{Compared, Features, mean_of, recentred};

use super::config::WINDOW;
use super::found::Found;
use super::outcome::{Curve, Figure, Mark, Removed, Rollout};
use crate::error::EvaluationError;

/// Values of one source: at each mark FDπ and its resamples, × 100.
type Values = Vec<(f64, Vec<f64>)>;

/// Measures the curve of every source.
pub(super) fn of(found: &Found<'_>) -> Result<Rollout, EvaluationError> {
    let config = found.config;
    let sources: Vec<usize> = config.others().map(|(at, _)| at).collect();
    let panel = found.panel();
    // By mark, then policy, then source.
    let mut values: Vec<Values> = vec![Vec::new(); sources.len()];
    for mark in 0..config.marks.len() {
        let mut sums = vec![(0.0, Vec::new()); sources.len()];
        for at in &panel {
            let sets = &found.sets[*at];
            let compared = Compared::new(&sets.name, at_mark(&sets.real, mark))?;
            let others: Vec<Features> = sources.iter().map(|source| at_mark(&sets.others[*source], mark)).collect();
            let named: Vec<(&str, &Features)> =
                sources.iter().map(|source| config.sources[*source].name()).zip(&others).collect();
            let drawn = compared.resampled(&named, config.draws)?;
            for (sum, ((name, other), drawn)) in sums.iter_mut().zip(named.iter().zip(drawn)) {
                sum.0 += 100.0 * compared.distance(name, other)?.value / panel.len() as f64;
                sum.1.push(drawn);
            }
        }
        for (values, (value, drawn)) in values.iter_mut().zip(sums) {
            let drawn: Vec<&[f64]> = drawn.iter().map(Vec::as_slice).collect();
            values.push((value, mean_of(&drawn).iter().map(|value| 100.0 * value).collect()));
        }
    }
    let curve = |(source, values): (&usize, &Values)| {
        let mark = |(frame, (value, drawn)): (&u32, &(f64, Vec<f64>))| Mark {
            frame: *frame,
            fd_pi: Figure::of(recentred(*value, drawn.clone()), 1.0),
        };
        let (rise, drawn) = rise(values);
        Curve {
            source: config.sources[*source].name().to_owned(),
            marks: config.marks.iter().zip(values).map(mark).collect(),
            rise: Figure::of(recentred(rise, drawn), 1.0),
        }
    };
    let of_name = |name: &String| sources.iter().position(|source| config.sources[*source].name() == name);
    let removed = |[without, with]: &[String; 2]| {
        let (base, own) = (rise(&values[of_name(without)?]), rise(&values[of_name(with)?]));
        let drawn = own.1.iter().zip(&base.1).map(|(own, base)| 1.0 - own / base).collect();
        // A share of a rise that is none says nothing.
        let share = (base.0 > 0.0).then(|| Figure::of(recentred(1.0 - own.0 / base.0, drawn), 1.0));
        Some(Removed { without: without.clone(), with: with.clone(), share })
    };
    Ok(Rollout {
        curves: sources.iter().zip(&values).map(curve).collect(),
        removed: config.ratios.iter().filter_map(removed).collect(),
    })
}

/// Returns the rise from the first mark to the last.
fn rise(values: &Values) -> (f64, Vec<f64>) {
    let (Some(first), Some(last)) = (values.first(), values.last()) else { return (0.0, Vec::new()) };
    (last.0 - first.0, last.1.iter().zip(&first.1).map(|(last, first)| last - first).collect())
}

/// Returns the rows of a mark's window.
fn at_mark(features: &Features, mark: usize) -> Features {
    let window = WINDOW as usize;
    Features(features.0.iter().map(|rows| rows.rows(mark * window, window).into_owned()).collect())
}
