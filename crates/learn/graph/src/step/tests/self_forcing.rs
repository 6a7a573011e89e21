//! Self Forcing's two promises: the gradient of its loss is g / N, and it reaches the exit step alone.

use super::*;

/// One query step over all chunks, with context as a cache gives it.
fn exit_step(target: Array) -> CausalPlan {
    CausalPlan {
        context_trained: false,
        context_detached: true,
        target,
        ..plan(1, 1, 4, Positions::CacheRelative, 1..FRAMES)
    }
}

#[test]
fn the_gradient_is_the_given_direction_over_the_number_of_values() {
    let (weights, batch) = (weights(&SHAPE.declare()), batch(1));
    let n = SHAPE.tokens();
    let shape = [1, FRAMES - 1, n, 4, 3];
    let probe = exit_step(Array::zeros(&shape));
    let output = causal_output(&SHAPE, &weights, &batch, &probe);
    let made = &output.values()[FRAMES * n * 12..];
    let direction = draw("direction", &shape);
    let target = made.iter().zip(direction.values()).map(|(made, g)| made - g).collect();
    let step = causal(&SHAPE, &weights, &batch, &exit_step(Array::new(&shape, target))).scaled(0.5);
    // The bias of the head adds to every output, so its gradient is the sum of those of the outputs.
    let found = step.gradient.get("head.head.bias").expect("declared");
    let count = direction.values().len() as f32;
    let mut expected = vec![0.0; 12];
    direction.values().iter().enumerate().for_each(|(at, g)| expected[at % 12] += g / count);
    for (found, expected) in found.values().iter().zip(&expected) {
        assert!((found - expected).abs() < 1e-5, "{found} and {expected}");
    }
    let squares: f32 = direction.values().iter().map(|g| g * g).sum();
    assert!((step.loss - 0.5 * squares / count).abs() < 1e-4);
}

/// Rolls the context out with some weights, keeps its cache, and runs the exit steps with other weights against it.
fn loss_against_kept_cache(kept: &Weights, moved: &Weights, batch: &ClipBatch, plan: &CausalPlan) -> f64 {
    let (keeper, mover) = (Dit::new(&SHAPE, kept).expect("fits"), Dit::new(&SHAPE, moved).expect("fits"));
    let n = SHAPE.tokens();
    let first = frames_of(&batch.clean, 0..1);
    let start = Array::new(first.shape(), batch.start.values().to_vec());
    let contexts = [&keeper, &mover].map(|dit| dit.context(&batch.text, &batch.start));
    let mut cache = KvCache::new(plan.cache);
    let (mut sum, mut count) = (0.0, 0.0);
    for frame in 0..FRAMES {
        let layouts = Array::new(&[1, n, 4, 12], batch.layouts.values()[frame * n * 48..(frame + 1) * n * 48].to_vec());
        if frame > 0 {
            let control = mover.control(&layouts);
            let noisy = frames_of(&plan.query, frame - 1..frame);
            let chunk = Chunk { noisy: &noisy, start: &start, control: &control, time: 1000.0 * plan.query_level.0 };
            let (output, _) = mover.denoise(&chunk, &cache.window(&mover, 1), &contexts[1]);
            let target = frames_of(&plan.target, frame - 1..frame);
            for (found, target) in output.values().iter().zip(target.values()) {
                sum += f64::from(found - target).powi(2);
                count += 1.0;
            }
        }
        let control = keeper.control(&layouts);
        let (noisy, time) = if frame == 0 {
            (first.clone(), 0.0)
        } else {
            (frames_of(&plan.context, frame - 1..frame), 1000.0 * plan.context_level.0)
        };
        let chunk = Chunk { noisy: &noisy, start: &start, control: &control, time };
        cache.commit(&keeper.denoise(&chunk, &cache.window(&keeper, 1), &contexts[0]).1);
    }
    sum / count
}

#[test]
fn the_gradient_reaches_the_exit_step_alone() {
    let (weights, batch) = (weights(&SHAPE.declare()), batch(1));
    let plan = exit_step(draw("target", &[1, FRAMES - 1, SHAPE.tokens(), 4, 3]));
    let step = causal(&SHAPE, &weights, &batch, &plan);
    let whole = f64::from(step.loss);
    let kept = loss_against_kept_cache(&weights, &weights, &batch, &plan);
    assert!((whole - kept).abs() < 1e-4 * whole, "{whole} and {kept}");
    let moved = |by: f32, name: &str| {
        let mut moved = weights.clone();
        let array = weights.get(name).expect("declared");
        let drawn = draw(&format!("direction/{name}"), array.shape());
        let values = array.values().iter().zip(drawn.values()).map(|(value, d)| value + by * d).collect();
        moved.insert(name, Array::new(array.shape(), values));
        moved
    };
    let through = causal(&SHAPE, &weights, &batch, &CausalPlan { context_detached: false, ..plan.clone() });
    for name in ["blocks.0.self_attn.v.weight", "blocks.1.ffn.2.weight", "patch_embedding.weight"] {
        let along = |step: &Step| -> f64 {
            let array = step.gradient.get(name).expect("declared");
            let drawn = draw(&format!("direction/{name}"), array.shape());
            array.values().iter().zip(drawn.values()).map(|(g, d)| f64::from(*g) * f64::from(*d)).sum()
        };
        let loss = |by: f32| loss_against_kept_cache(&weights, &moved(by, name), &batch, &plan);
        let difference = (loss(1e-3) - loss(-1e-3)) / 2e-3;
        let (found, other) = (along(&step), along(&through));
        assert!((found - difference).abs() < 0.02 * difference.abs() + 2e-3, "{name}: {found} and {difference}");
        assert!((found - other).abs() > 1e-4, "{name}: the cache carries gradient too, {found} and {other}");
    }
}
