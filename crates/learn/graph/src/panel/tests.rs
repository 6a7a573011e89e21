//! Every network: gradients are slopes, the context knows nothing of the state, weights that do not fit are named.

use ds_space::{Digest, Draws};

use super::*;

fn noise(shape: &[usize], seed: u64) -> Array {
    let draws = Draws::from_seed(seed, "panel test");
    #[expect(clippy::cast_possible_truncation, reason = "inputs are single precision")]
    let values = (0..shape.iter().product::<usize>() as u64).map(|i| draws.normal(i) as f32).collect();
    Array::new(shape, values)
}

/// Half the sum of squares of all heads, with its gradient.
fn square(answer: &Answer) -> (f64, Answer) {
    let heads = answer.plans.iter().chain(&answer.scores);
    let loss = heads.flat_map(|head| head.values()).map(|value| 0.5 * f64::from(*value).powi(2)).sum();
    (loss, answer.clone())
}

fn fresh(kind: Kind) -> Weights {
    Weights::initialised(&kind.declared(), &Digest::of(kind.name().as_bytes()))
}

#[test]
fn gradients_are_the_slopes_of_the_loss() {
    let (images, state) = (noise(&[2, HEIGHT_PX, WIDTH_PX, 3], 1), noise(&[2, STATE], 2));
    let inputs = Inputs { images: &images, state: &state };
    for kind in Kind::ALL {
        let weights = fresh(kind);
        let (loss, slopes) = gradient(kind, &weights, &inputs, square).expect("the weights fit");
        let at = |weights: &Weights| square(&Network::new(kind, weights).expect("fits").answer(&inputs)).0;
        assert!((at(&weights) - loss).abs() < 1e-3 * loss.max(1.0), "{}", kind.name());
        // One weight of each part of the network.
        let names = weights.iter().map(|(name, _)| name.to_owned()).collect::<Vec<_>>();
        for name in names.iter().step_by(17) {
            let slope = slopes.get(name).expect("every weight has a gradient").clone();
            let norm2: f64 = slope.values().iter().map(|value| f64::from(*value).powi(2)).sum();
            if norm2 < 1e-9 * loss {
                continue;
            }
            let step = 5e-4 * loss / norm2;
            let moved = |sign: f64| {
                let mut moved = weights.clone();
                let array = moved.get_mut(name).expect("it is there");
                #[expect(clippy::cast_possible_truncation, reason = "weights are single precision")]
                array.values_mut().iter_mut().zip(slope.values()).for_each(|(w, g)| *w += (sign * step) as f32 * g);
                at(&moved)
            };
            let rose = (moved(1.0) - moved(-1.0)) / (2.0 * step * norm2);
            assert!((rose - 1.0).abs() < 0.1, "{} {name}: the loss rose by {rose} of its slope", kind.name());
        }
    }
}

#[test]
fn plans_depend_on_frame_and_state_and_the_context_on_the_frame_alone() {
    let (images, other) = (noise(&[1, HEIGHT_PX, WIDTH_PX, 3], 3), noise(&[1, HEIGHT_PX, WIDTH_PX, 3], 4));
    let (state, told) = (noise(&[1, STATE], 5), noise(&[1, STATE], 6));
    for kind in Kind::ALL {
        let network = Network::new(kind, &fresh(kind)).expect("the weights fit");
        let answer = |images, state| network.answer(&Inputs { images, state });
        let first = answer(&images, &state);
        assert_eq!(first, answer(&images, &state), "{}", kind.name());
        assert_ne!(first, answer(&other, &state), "{} is blind", kind.name());
        assert_ne!(first, answer(&images, &told), "{} knows no state", kind.name());
        let context = network.context(&images);
        assert_eq!(context.shape().len(), 3);
        if let Some([rows, columns]) = kind.grid() {
            assert_eq!(context.shape()[1], rows * columns);
        }
        assert_ne!(context, network.context(&other));
        assert!(fresh(kind).parameters() < 2_500_000, "{}: {}", kind.name(), fresh(kind).parameters());
    }
}

#[test]
fn weights_of_another_network_are_named() {
    let error = Network::new(Kind::Ltf, &fresh(Kind::Drivor)).err().expect("they differ").to_string();
    assert!(error.contains("missing") || error.contains("shape"), "{error}");
    assert_eq!(Kind::of("drivor"), Some(Kind::Drivor));
    assert_eq!(Kind::of("camera"), None);
}
