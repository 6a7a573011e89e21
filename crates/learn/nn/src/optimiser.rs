//! AdamW, gradient clipping, the exponential moving average and the learning-rate schedule, over plain weights.
//!
//! The update is `m ← β1·m + (1−β1)·g; v ← β2·v + (1−β2)·g²; w ← w − lr·(m̂/(√v̂ + ε) + decay·w)` with bias-corrected
//! m̂ and v̂. Decay applies to matrices only. Everything is a pure function of its inputs, so that a training run can
//! be stopped and resumed from its files.

use serde::{Deserialize, Serialize};

use crate::array::Weights;

/// Settings of AdamW.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdamWSettings {
    /// Decay rate of the first moment.
    pub beta1: f32,
    /// Decay rate of the second moment.
    pub beta2: f32,
    /// Added to the root of the second moment.
    pub epsilon: f32,
    /// Decoupled weight decay.
    pub weight_decay: f32,
    /// The largest Euclidean norm of the gradient; longer ones are scaled down.
    pub clip_norm: f32,
}

impl Default for AdamWSettings {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.95, epsilon: 1e-8, weight_decay: 0.01, clip_norm: 1.0 }
    }
}

/// The state of AdamW.
#[derive(Debug, Clone, PartialEq)]
pub struct AdamW {
    settings: AdamWSettings,
    /// Updates made so far.
    pub steps: u32,
    /// First moments.
    pub first: Weights,
    /// Second moments.
    pub second: Weights,
}

impl AdamW {
    /// Starts with zero moments.
    #[must_use]
    pub fn new(settings: AdamWSettings, weights: &Weights) -> Self {
        Self { settings, steps: 0, first: weights.zeros_like(), second: weights.zeros_like() }
    }

    /// Continues from stored moments.
    #[must_use]
    pub fn resumed(settings: AdamWSettings, steps: u32, first: Weights, second: Weights) -> Self {
        Self { settings, steps, first, second }
    }

    /// Returns its settings.
    #[must_use]
    pub fn settings(&self) -> AdamWSettings {
        self.settings
    }

    /// Updates the weights and returns the norm that the gradient had before clipping. A gradient that is not finite
    /// changes nothing.
    pub fn update(&mut self, weights: &mut Weights, gradient: &Weights, learning_rate: f32) -> f32 {
        self.update_each(weights, gradient, &|_| learning_rate)
    }

    /// As [`Self::update`], each weight at its own learning rate, asked by its name.
    pub fn update_each(&mut self, weights: &mut Weights, gradient: &Weights, rate: &dyn Fn(&str) -> f32) -> f32 {
        let squares = |weights: &Weights| -> f64 {
            weights.iter().flat_map(|(_, array)| array.values()).map(|value| f64::from(*value).powi(2)).sum()
        };
        #[expect(clippy::cast_possible_truncation, reason = "a norm in single precision is enough")]
        let norm = squares(gradient).sqrt() as f32;
        if !norm.is_finite() {
            return norm;
        }
        self.steps += 1;
        let scale = if norm > self.settings.clip_norm { self.settings.clip_norm / norm } else { 1.0 };
        let AdamWSettings { beta1, beta2, epsilon, weight_decay, .. } = self.settings;
        let steps = self.steps.min(1 << 20) as i32;
        let (correct1, correct2) = (1.0 - beta1.powi(steps), 1.0 - beta2.powi(steps));
        let moments = self.first.iter_mut().zip(self.second.iter_mut());
        for ((name, array), ((_, first), (_, second))) in weights.iter_mut().zip(moments) {
            let Some(gradient) = gradient.get(name) else { continue };
            let learning_rate = rate(name);
            let decay = if array.shape().len() > 1 { weight_decay } else { 0.0 };
            let each = array.values_mut().iter_mut().zip(gradient.values());
            let each = each.zip(first.values_mut().iter_mut().zip(second.values_mut()));
            for ((weight, gradient), (first, second)) in each {
                let gradient = gradient * scale;
                *first = beta1 * *first + (1.0 - beta1) * gradient;
                *second = beta2 * *second + (1.0 - beta2) * gradient * gradient;
                let step = (*first / correct1) / ((*second / correct2).sqrt() + epsilon);
                *weight -= learning_rate * (step + decay * *weight);
            }
        }
        norm
    }
}

/// Moves `average` towards `weights`: `average ← decay·average + (1 − decay)·weights`.
pub fn move_average(average: &mut Weights, weights: &Weights, decay: f32) {
    for ((_, average), (_, array)) in average.iter_mut().zip(weights.iter()) {
        for (average, value) in average.values_mut().iter_mut().zip(array.values()) {
            *average = decay * *average + (1.0 - decay) * value;
        }
    }
}

/// How a learning rate goes on after its warm-up.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// It stays at its highest.
    Constant,
    /// It falls along a cosine to a tenth at the last update.
    #[default]
    Cosine,
    /// It falls in a straight line to a tenth at the last update.
    Linear,
}

/// A learning rate that rises linearly, then goes on in its shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    /// The highest rate.
    pub peak: f32,
    /// Updates until the peak.
    pub warm_up: u32,
    /// Updates in all.
    pub total: u32,
    /// The way after the peak.
    pub shape: Shape,
}

impl Schedule {
    /// Returns the rate of update `step`, counted from 0.
    #[must_use]
    pub fn rate(&self, step: u32) -> f32 {
        if step < self.warm_up {
            return self.peak * (step + 1) as f32 / self.warm_up as f32;
        }
        let span = self.total.saturating_sub(self.warm_up).max(1);
        let done = ((step - self.warm_up) as f32 / span as f32).min(1.0);
        match self.shape {
            Shape::Constant => self.peak,
            Shape::Cosine => self.peak * (0.1 + 0.45 * (1.0 + (std::f32::consts::PI * done).cos())),
            Shape::Linear => self.peak * (1.0 - 0.9 * done),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::array::Array;

    #[test]
    fn a_quadratic_is_minimised() {
        let mut weights = Weights::default();
        weights.insert("w", Array::new(&[3], vec![4.0, -3.0, 0.5]));
        let settings = AdamWSettings { weight_decay: 0.0, clip_norm: 10.0, ..AdamWSettings::default() };
        let mut adam = AdamW::new(settings, &weights);
        for _ in 0..400 {
            let mut gradient = weights.clone();
            for (_, array) in gradient.iter_mut() {
                array.values_mut().iter_mut().for_each(|value| *value = 2.0 * (*value - 1.0));
            }
            adam.update(&mut weights, &gradient, 0.05);
        }
        let worst = weights.iter().flat_map(|(_, a)| a.values()).fold(0.0f32, |w, v| w.max((v - 1.0).abs()));
        assert!(worst < 0.02, "{weights:?}");
    }

    #[test]
    fn the_first_update_moves_each_weight_by_the_rate() {
        let mut weights = Weights::default();
        weights.insert("w", Array::new(&[2], vec![1.0, 1.0]));
        let mut gradient = Weights::default();
        gradient.insert("w", Array::new(&[2], vec![0.5, -0.001]));
        AdamW::new(AdamWSettings::default(), &weights).update(&mut weights, &gradient, 0.1);
        let values = weights.get("w").expect("inserted above").values();
        assert!((values[0] - 0.9).abs() < 1e-4 && (values[1] - 1.1).abs() < 1e-4, "{values:?}");
    }

    #[test]
    fn a_gradient_that_is_not_finite_changes_nothing() {
        let mut weights = Weights::default();
        weights.insert("w", Array::new(&[1], vec![1.0]));
        let mut gradient = Weights::default();
        gradient.insert("w", Array::new(&[1], vec![f32::NAN]));
        let mut adam = AdamW::new(AdamWSettings::default(), &weights);
        assert!(adam.update(&mut weights, &gradient, 0.1).is_nan());
        assert_eq!((weights.get("w").expect("inserted above").values()[0], adam.steps), (1.0, 0));
    }

    #[test]
    fn a_schedule_rises_then_goes_on_in_its_shape() {
        for (shape, middle, end) in
            [(Shape::Constant, 1.0, 1.0), (Shape::Cosine, 0.55, 0.1), (Shape::Linear, 0.55, 0.1)]
        {
            let schedule = Schedule { peak: 1.0, warm_up: 10, total: 110, shape };
            let rates = [(0, 0.1), (9, 1.0), (10, 1.0), (60, middle), (110, end), (200, end)];
            assert!(rates.iter().all(|&(step, rate)| (schedule.rate(step) - rate).abs() < 1e-6), "{shape:?}");
        }
    }
}
