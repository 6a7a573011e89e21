//! Two diagnoses of one case, made by diagnosers that look at different data of it, as one.

use ds_effect::Verdict;

use crate::schema::Diagnosis;

impl Diagnosis {
    /// Adds what another diagnoser found in data of the same case that this one does not look at.
    ///
    /// What the other found is true beside what was found here: verdicts add up, and both belong to the corrected model.
    /// The list of effects shares one probability among its suspects: the other's findings keep theirs where nothing was
    /// found here and take half beside another effect, behind the first; all else shrinks to what is left. Where the
    /// other found nothing, nothing changes.
    pub fn join(&mut self, other: Self) {
        let found: f64 = other.effects.iter().map(|finding| finding.probability).sum();
        if other.verdict == Verdict::None || found <= 0.0 {
            return;
        }
        let share = if self.verdict == Verdict::None { found } else { 0.5 };
        self.verdict = match self.verdict {
            Verdict::None => other.verdict,
            Verdict::Single | Verdict::Multiple => Verdict::Multiple,
            Verdict::Unknown => Verdict::Unknown,
        };
        self.effects.iter_mut().for_each(|finding| finding.probability *= 1.0 - share);
        self.p_none *= 1.0 - share;
        self.p_unknown *= 1.0 - share;
        let at = if share > 0.5 { 0 } else { self.effects.len().min(1) };
        let theirs = other.effects.into_iter().map(|mut finding| {
            finding.probability = share * (finding.probability / found);
            finding
        });
        self.effects.splice(at..at, theirs);
        self.chosen.extend(other.chosen);
        self.cells.extend(other.cells);
        self.corrected_model.effects.extend(other.corrected_model.effects);
        self.corrected_model.nuisance.extend(other.corrected_model.nuisance);
        self.warnings.extend(other.warnings);
    }
}
