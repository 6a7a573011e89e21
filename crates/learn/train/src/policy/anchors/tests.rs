//! Anchors: the nearest one's plan is drawn, and the gradient of the loss is its slope.

use ds_space::Draws;

use super::*;

#[test]
fn the_plan_of_the_nearest_anchor_is_drawn_and_the_gradient_is_the_slope() {
    let draws = Draws::from_seed(5, "anchor loss");
    #[expect(clippy::cast_possible_truncation, reason = "made-up numbers")]
    let normal = |index: usize| 0.5 * draws.normal(index as u64) as f32;
    let anchors = Array::new(&[3, POINTS], (0..3 * POINTS).map(normal).collect());
    let targets: [[f32; TARGETS]; 2] = std::array::from_fn(|b| std::array::from_fn(|k| normal(900 + 100 * b + k)));
    let heads = |width: usize, first: usize| -> Vec<Array> {
        let one = |layer: usize| {
            Array::new(&[2, 3, width], (0..6 * width).map(|k| normal(first + 1000 * layer + k)).collect())
        };
        (0..2).map(one).collect()
    };
    let answer = Answer { plans: heads(PLAN, 2_000), scores: heads(1, 6_000) };
    let (_, slope) = grade(&answer, &anchors, &targets);
    for layer in 0..2 {
        let drawn =
            slope.plans[layer].values().chunks_exact(PLAN).filter(|plan| plan.iter().any(|value| *value != 0.0));
        assert_eq!(drawn.count(), 2, "one plan of each sample");
    }
    let at = |change: &dyn Fn(&mut Answer)| {
        let mut moved = answer.clone();
        change(&mut moved);
        grade(&moved, &anchors, &targets).0
    };
    let check = |what: &str, analytic: f32, up: f64, down: f64| {
        let numeric = (up - down) / 1e-2;
        assert!((numeric - f64::from(analytic)).abs() < 2e-4, "{what}: {numeric} by difference, {analytic} by formula");
    };
    for index in (0..2 * 3 * PLAN).step_by(7) {
        let by = |offset: f32| at(&|moved| moved.plans[1].values_mut()[index] += offset);
        check("plans", slope.plans[1].values()[index], by(5e-3), by(-5e-3));
    }
    for index in 0..6 {
        let by = |offset: f32| at(&|moved| moved.scores[0].values_mut()[index] += offset);
        check("logits", slope.scores[0].values()[index], by(5e-3), by(-5e-3));
    }
}
