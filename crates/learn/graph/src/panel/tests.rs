//! Every network: gradients are slopes, the context knows nothing of the state, weights that do not fit are named.

use ds_space::{Digest, Draws};

use super::*;

fn noise(shape: &[usize], seed: u64) -> Array {
    let draws = Draws::from_seed(seed, "panel test");
    #[expect(clippy::cast_possible_truncation, reason = "inputs are single precision")]
    let values = (0..shape.iter().product::<usize>() as u64).map(|i| draws.normal(i) as f32).collect();
    Array::new(shape, values)
}

/// Half the sum of squares of the heads that count for a weight, with its gradient. Between the layers of
/// `diffusiondrive` points are cut off, so weights before its second layer count by the first read-out alone.
fn square(kind: Kind, name: &str, answer: &Answer) -> (f64, Answer) {
    let mut slope = answer.clone();
    if kind == Kind::Diffusiondrive {
        let silent = usize::from(!name.starts_with("plans1"));
        for heads in [&mut slope.plans, &mut slope.scores] {
            heads[silent].values_mut().fill(0.0);
        }
    }
    let heads = slope.plans.iter().chain(&slope.scores);
    let loss = heads.flat_map(|head| head.values()).map(|value| 0.5 * f64::from(*value).powi(2)).sum();
    (loss, slope)
}

/// What a test shows of two frames: noise everywhere.
struct Shown {
    images: Array,
    state: Array,
    noise: Array,
    times: Vec<u32>,
}

impl Shown {
    fn of(kind: Kind, batch: usize, seed: u64) -> Self {
        Self {
            images: noise(&[batch, HEIGHT_PX, WIDTH_PX, 3], seed),
            state: noise(&[batch, STATE], seed + 1),
            noise: noise(&[batch, kind.noise()], seed + 2),
            times: (0..batch as u32).map(|sample| 7 + 11 * sample).collect(),
        }
    }

    /// The inputs of one step of training.
    fn learning(&self) -> Inputs<'_> {
        Inputs { times: Some(&self.times), ..self.answering() }
    }

    fn answering(&self) -> Inputs<'_> {
        Inputs { images: &self.images, state: &self.state, noise: &self.noise, times: None }
    }
}

fn fresh(kind: Kind) -> Weights {
    Weights::initialised(&kind.declared(), &Digest::of(kind.name().as_bytes()))
}

#[test]
fn gradients_are_the_slopes_of_the_loss() {
    for kind in Kind::ALL {
        let (weights, shown) = (fresh(kind), Shown::of(kind, 2, 1));
        let inputs = shown.learning();
        // One weight of each part of the network; the anchors are not trained.
        let names = weights.iter().map(|(name, _)| name.to_owned()).collect::<Vec<_>>();
        for name in names.iter().step_by(17).filter(|name| Some(name.as_str()) != kind.anchors()) {
            let grade = |answer: &Answer| square(kind, name, answer);
            let (loss, slopes) = gradient(kind, &weights, &inputs, grade).expect("the weights fit");
            let at = |weights: &Weights| grade(&Network::new(kind, weights).expect("fits").answer(&inputs)).0;
            assert!((at(&weights) - loss).abs() < 1e-3 * loss.max(1.0), "{}", kind.name());
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
    for kind in Kind::ALL {
        let network = Network::new(kind, &fresh(kind)).expect("the weights fit");
        let (shown, other) = (Shown::of(kind, 1, 3), Shown::of(kind, 1, 13));
        let (inputs, others) = (shown.answering(), other.answering());
        let first = network.answer(&inputs);
        assert_eq!(first, network.answer(&inputs), "{}", kind.name());
        assert_ne!(first, network.answer(&Inputs { images: others.images, ..inputs }), "{} is blind", kind.name());
        assert_ne!(first, network.answer(&Inputs { state: others.state, ..inputs }), "{} knows no state", kind.name());
        let redrawn = network.answer(&Inputs { noise: others.noise, ..inputs });
        assert_eq!(first == redrawn, kind.noise() == 0, "{}", kind.name());
        let context = network.context(&shown.images);
        assert_eq!(context.shape().len(), 3);
        if let Some([rows, columns]) = kind.grid() {
            assert_eq!(context.shape()[1], rows * columns);
        }
        assert_ne!(context, network.context(&other.images));
        assert!(fresh(kind).parameters() < 2_500_000, "{}: {}", kind.name(), fresh(kind).parameters());
        let logits = match kind.scoring() {
            Scoring::Single => vec![],
            Scoring::Terms => vec![vec![1, first.plans[0].shape()[1], TERMS]],
            Scoring::Confidence => vec![vec![1, first.plans[0].shape()[1], 1]; first.plans.len()],
        };
        assert_eq!(first.scores.iter().map(|scores| scores.shape().to_vec()).collect::<Vec<_>>(), logits);
    }
}

#[test]
fn plans_of_diffusion_stay_with_their_anchors_and_batches_are_not_mixed() {
    let kind = Kind::Diffusiondrive;
    let mut weights = fresh(kind);
    // A network that answers no offset: all that is left of the noise is that of the last time.
    for layer in 0..2 {
        for part in ["weight", "bias"] {
            weights.get_mut(&format!("plans{layer}.read.1.{part}")).expect("declared").values_mut().fill(0.0);
        }
    }
    let anchors = weights.get(kind.anchors().expect("it has them")).expect("declared").clone();
    let shown = Shown::of(kind, 2, 23);
    let answer = Network::new(kind, &weights).expect("fits").answer(&shown.answering());
    let plans = answer.plans.last().expect("there are two");
    for (plan, anchor) in plans.values().chunks_exact(PLAN).zip(anchors.values().chunks_exact(16).cycle()) {
        for (pose, point) in plan.chunks_exact(3).zip(anchor.chunks_exact(2)) {
            let far = (pose[0] - point[0]).abs().max((pose[1] - point[1]).abs());
            assert!(far < 1.2 && pose[2] == 0.0, "{far} away");
        }
    }
    let network = Network::new(kind, &fresh(kind)).expect("fits");
    let both = network.answer(&shown.answering()).plans[1].clone();
    let half = |array: &Array, which: usize| {
        let row = array.values().len() / 2;
        let shape: Vec<usize> = std::iter::once(1).chain(array.shape()[1..].iter().copied()).collect();
        Array::new(&shape, array.values()[which * row..][..row].to_vec())
    };
    for which in 0..2 {
        let [images, state, noise] = [&shown.images, &shown.state, &shown.noise].map(|array| half(array, which));
        let alone = network.answer(&Inputs { images: &images, state: &state, noise: &noise, times: None });
        let pairs = alone.plans[1].values().iter().zip(half(&both, which).into_values());
        pairs.for_each(|(one, other)| assert!((one - other).abs() < 1e-3, "{one} alone, {other} beside another"));
    }
}

#[test]
fn weights_of_another_network_are_named() {
    let error = Network::new(Kind::Ltf, &fresh(Kind::Drivor)).err().expect("they differ").to_string();
    assert!(error.contains("missing") || error.contains("shape"), "{error}");
    assert_eq!(Kind::of("drivor"), Some(Kind::Drivor));
    assert_eq!(Kind::of("camera"), None);
}
