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
/// `diffusiondrive` points are cut off, so weights before its second layer count by the first read-out alone; so do
/// weights of `sparsedrive`, where what is kept goes on, and its plans are given. So are those of `diffusiondrive_v2`, whose weights before
/// its second layer count by the first sub-scores. Those of `rap` count by the first plans that
/// they bear on, before poses are cut off.
fn square(kind: Kind, name: &str, answer: &Answer) -> (f64, Answer) {
    let mut slope = answer.clone();
    let silence = |head: &mut Array| head.values_mut().fill(0.0);
    if kind == Kind::Diffusiondrive {
        let silent = usize::from(!name.starts_with("plans1"));
        silence(&mut slope.plans[silent]);
        silence(&mut slope.scores[silent]);
    }
    if kind == Kind::DiffusiondriveV2 {
        slope.plans.iter_mut().for_each(silence);
        silence(&mut slope.scores[usize::from(!name.starts_with("selector.fine"))]);
    }
    if kind == Kind::Rap {
        let [first, second, domain, scores] = [0, 1, 3, 4];
        let counts = match name.split('.').next() {
            Some("domain") => domain,
            Some("scores") => scores,
            Some("queries" | "state" | "read") => first,
            _ => second,
        };
        let heads = slope.plans.iter_mut().chain(&mut slope.scores).enumerate();
        heads.filter(|(head, _)| *head != counts).for_each(|(_, head)| silence(head));
    }
    if kind == Kind::Sparsedrive {
        silence(&mut slope.plans[0]);
        let counts = match name.split('.').next() {
            Some("plans") => [4, 5],
            Some("paths1" | "profiles1") => [2, 3],
            _ => [0, 1],
        };
        (0..slope.scores.len()).filter(|head| !counts.contains(head)).for_each(|head| silence(&mut slope.scores[head]));
        let left_out = |value: &&mut f32| **value <= sparsedrive::LEFT_OUT;
        slope.scores.iter_mut().flat_map(Array::values_mut).filter(left_out).for_each(|value| *value = 0.0);
    }
    let heads = slope.plans.iter().chain(&slope.scores);
    let loss = heads.flat_map(|head| head.values()).map(|value| 0.5 * f64::from(*value).powi(2)).sum();
    (loss, slope)
}

/// What a test shows of two frames: noise everywhere.
struct TwoFrames {
    images: Array,
    state: Array,
    noise: Array,
    times: Vec<u32>,
}

impl TwoFrames {
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
        Inputs { images: &self.images, state: &self.state, noise: &self.noise, times: None, reversal: 1.0 }
    }
}

fn fresh(kind: Kind) -> Weights {
    Weights::initialised(&kind.declared(), &Digest::of(kind.name().as_bytes()))
}

#[test]
fn gradients_are_the_slopes_of_the_loss() {
    for kind in Kind::ALL {
        let (weights, shown) = (fresh(kind), TwoFrames::of(kind, 2, 1));
        let inputs = shown.learning();
        // One weight of each part of the network; what is given is not trained.
        let names = weights.iter().map(|(name, _)| name.to_owned()).collect::<Vec<_>>();
        for name in names.iter().step_by(17).filter(|name| kind.trains(name)) {
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
        let (shown, other) = (TwoFrames::of(kind, 1, 3), TwoFrames::of(kind, 1, 13));
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
            Scoring::FilteredTerms => vec![vec![1, 60, TERMS], vec![1, 16, TERMS]],
            Scoring::Confidence => vec![vec![1, first.plans[0].shape()[1], 1]; first.plans.len()],
            Scoring::Total => vec![vec![1, 1, 1], vec![1, first.plans[0].shape()[1], TERMS]],
            Scoring::ConfidenceAndTerms => {
                let words = [128, 32, 128, 32].map(|words| vec![1, words, 1]);
                words.into_iter().chain([vec![1, 64, 1], vec![1, 64, TERMS]]).collect()
            }
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
    let anchors = weights.get(kind.given()[0]).expect("declared").clone();
    let shown = TwoFrames::of(kind, 2, 23);
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
        let alone =
            network.answer(&Inputs { images: &images, state: &state, noise: &noise, times: None, reversal: 0.0 });
        let pairs = alone.plans[1].values().iter().zip(half(&both, which).into_values());
        pairs.for_each(|(one, other)| assert!((one - other).abs() < 1e-3, "{one} alone, {other} beside another"));
    }
}

#[test]
fn sparsedrive_keeps_the_words_of_largest_logits_and_its_plans_are_of_the_vocabulary() {
    let kind = Kind::Sparsedrive;
    let (weights, shown) = (fresh(kind), TwoFrames::of(kind, 2, 31));
    let answer = Network::new(kind, &weights).expect("fits").answer(&shown.answering());
    let left = |head: usize, sample: usize| -> Vec<usize> {
        let words = answer.scores[head].shape()[1];
        let row = &answer.scores[head].values()[sample * words..][..words];
        (0..words).filter(|word| row[*word] > sparsedrive::LEFT_OUT).collect()
    };
    for sample in 0..2 {
        assert_eq!([0, 1, 2, 3].map(|head| left(head, sample).len()), [128, 32, 32, 16]);
        let first = &answer.scores[0].values()[sample * 128..][..128];
        let kept = left(2, sample);
        let least = kept.iter().map(|word| first[*word]).fold(f32::INFINITY, f32::min);
        assert!((0..128).filter(|word| !kept.contains(word)).all(|word| first[word] <= least));
        // Every plan is one of the kept paths at one of the kept profiles.
        let speed_mps = SPEED_MPS * f64::from(shown.state.values()[sample * STATE]);
        let [paths, profiles] = [0, 1].map(|which: usize| weights.get(kind.given()[which]).expect("declared"));
        let mut known = Vec::new();
        for path in kept {
            for profile in left(3, sample) {
                let along = vocabulary::along_m(&profiles.values()[8 * profile..][..8], speed_mps);
                let places = vocabulary::places(&paths.values()[48 * path..][..48], &along);
                known.push(vocabulary::plan_of(&places, speed_mps));
            }
        }
        for plan in answer.plans[0].values()[sample * 64 * PLAN..][..64 * PLAN].chunks_exact(PLAN) {
            let near = |known: &[f32; PLAN]| known.iter().zip(plan).all(|(a, b)| (a - b).abs() < 1e-3);
            assert!(known.iter().any(near));
        }
    }
}

#[test]
fn raps_context_unlearns_what_the_classifier_learns() {
    let kind = Kind::Rap;
    let (weights, shown) = (fresh(kind), TwoFrames::of(kind, 2, 41));
    let by = |reversal: f32, name: &str| {
        let grade = |answer: &Answer| square(kind, "domain", answer);
        let inputs = Inputs { reversal, ..shown.learning() };
        let (_, slopes) = gradient(kind, &weights, &inputs, grade).expect("the weights fit");
        slopes.get(name).expect("every weight has a gradient").clone()
    };
    assert_eq!(by(1.0, "domain.0.weight"), by(0.0, "domain.0.weight"));
    assert!(by(0.0, "neck.weight").values().iter().all(|slope| *slope == 0.0));
    let (once, twice) = (by(1.0, "neck.weight"), by(-2.0, "neck.weight"));
    for (reversed, straight) in once.values().iter().zip(twice.values()) {
        assert!((2.0 * reversed + straight).abs() < 1e-4 * straight.abs().max(1e-3), "{reversed} {straight}");
    }
    // Along its own gradient the classifier's loss falls by the context's weights.
    let slope = once;
    let at = |step: f32| {
        let mut moved = weights.clone();
        let array = moved.get_mut("neck.weight").expect("declared");
        array.values_mut().iter_mut().zip(slope.values()).for_each(|(weight, slope)| *weight += step * slope);
        square(kind, "domain", &Network::new(kind, &moved).expect("fits").answer(&shown.answering())).0
    };
    assert!(at(1e-2) < at(0.0) && at(0.0) < at(-1e-2), "{} {} {}", at(1e-2), at(0.0), at(-1e-2));
}

#[test]
fn weights_of_another_network_are_named() {
    let error = Network::new(Kind::Ltf, &fresh(Kind::Drivor)).err().expect("they differ").to_string();
    assert!(error.contains("missing") || error.contains("shape"), "{error}");
    assert_eq!(Kind::of("drivor"), Some(Kind::Drivor));
    assert_eq!(Kind::of("camera"), None);
}
