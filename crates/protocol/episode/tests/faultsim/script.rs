//! What goes wrong in a simulated run: how the network treats messages, and what happens to processes when.

use ds_episode::Outline;
use ds_space::{EpisodeId, SimTime, Tick};
use ds_topic::{EpisodeSpec, ObservationSource, Role};

/// Deterministic draws, cheap enough for millions of messages (SplitMix64).
#[derive(Debug, Clone)]
pub(crate) struct Dice(u64);

impl Dice {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed ^ 0x5851_F42D_4C95_7F2D)
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform over `low..=high`.
    pub(crate) fn range(&mut self, low: u64, high: u64) -> u64 {
        low + self.next() % (high - low + 1)
    }

    pub(crate) fn chance(&mut self, share: f64) -> bool {
        (self.next() >> 11) as f64 / ((1_u64 << 53) as f64) < share
    }

    pub(crate) fn pick<T: Copy>(&mut self, values: &[T]) -> T {
        values[(self.next() % values.len() as u64) as usize]
    }
}

/// How the bus treats messages.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Network {
    pub drop_pushes: f64,
    pub drop_pulls: f64,
    pub duplicate: f64,
    /// Up to this long; long delays reorder.
    pub delay_ms: u64,
    /// Share of messages with a ghost: the same slot with other content, of the epoch or term before, sent to those who
    /// know of the later one. What a late, broken predecessor could send; refusing it must leave no trace.
    pub ghosts: f64,
}

impl Network {
    pub(crate) const CALM: Self = Self { drop_pushes: 0.0, drop_pulls: 0.0, duplicate: 0.0, delay_ms: 1, ghosts: 0.0 };
}

/// When, seen from a stage's work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Moment {
    Before,
    Middle,
    After,
}

/// Something that happens to processes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Mishap {
    /// Kills the holder of a role (or a spare) at a time; it restarts as a new instance later.
    Kill { at: u64, worker: usize, restart_after: u64 },
    /// Kills whoever works on an iteration of a role, so many times.
    KillAtWork { role: Role, iteration: u32, moment: Moment, times: u32 },
    /// Stops a worker for a while; then it goes on as if nothing had been.
    Hang { at: u64, worker: usize, for_ms: u64 },
    /// Stops whoever works on an iteration of a role, once, in the middle of it.
    HangAtWork { role: Role, iteration: u32, for_ms: u64 },
    /// Cuts the nodes of a bit mask off from the others for a while (bit 0 and 1 are orchestrators).
    Partition { at: u64, mask: u32, for_ms: u64 },
    /// Kills the orchestrator; a new one resumes from the journal.
    KillOrchestrator { at: u64, restart_after: u64 },
    /// Starts a second orchestrator; the first never learns of it from the ledger if it is deaf.
    SecondOrchestrator { at: u64, deaf: bool },
    /// A worker says goodbye and starts anew later.
    Drain { at: u64, worker: usize, restart_after: u64 },
}

/// One simulated run.
#[derive(Debug, Clone)]
pub(crate) struct Script {
    pub seed: u64,
    pub outline: Outline,
    pub workers_per_role: usize,
    pub network: Network,
    pub mishaps: Vec<Mishap>,
    pub deaths_to_quarantine: usize,
    /// Whether each holder of the policy's role plans differently, as an external policy may.
    pub fickle_policy: bool,
}

/// An episode of some shape.
pub(crate) fn outline(dice: &mut Dice) -> Outline {
    let chunk_ticks = dice.range(0, 3) as u32;
    let observation = if chunk_ticks == 0 { ObservationSource::Reference } else { ObservationSource::Dreamstream };
    let spec = EpisodeSpec {
        policy: "toy".to_owned(),
        observation,
        replan_period: dice.range(1, 4) as u32,
        horizon: 8,
        history: dice.range(1, 3) as u32,
        warm_up: dice.range(0, 2) as u32,
        chunk_ticks,
        layout_memory_ticks: 2 * chunk_ticks,
        ..EpisodeSpec::replay(EpisodeId::new("toy").expect("a valid id"), "toy", Tick(dice.range(4, 9) as u32))
    };
    Outline { spec, cameras: dice.range(1, 2) as u16, dt: SimTime(100_000_000) }
}

impl Script {
    /// A run without faults.
    pub(crate) fn calm(seed: u64) -> Self {
        let outline = outline(&mut Dice::new(seed));
        let network = Network::CALM;
        Self {
            seed,
            outline,
            workers_per_role: 2,
            network,
            mishaps: Vec::new(),
            deaths_to_quarantine: 100,
            fickle_policy: false,
        }
    }

    /// A run with faults of all kinds, drawn by the seed.
    pub(crate) fn wild(seed: u64) -> Self {
        let mut script = Self::calm(seed);
        let mut dice = Dice::new(seed.wrapping_mul(0x9E37_79B9) ^ 1);
        script.network = Network {
            drop_pushes: dice.pick(&[0.0, 0.1, 0.3, 0.6, 1.0]),
            drop_pulls: dice.pick(&[0.0, 0.0, 0.1, 0.3]),
            duplicate: dice.pick(&[0.0, 0.1, 0.3]),
            delay_ms: dice.pick(&[1, 10, 60]),
            ghosts: dice.pick(&[0.0, 0.2]),
        };
        for _ in 0..dice.range(0, 3) {
            let at = dice.range(1, 1_500);
            let worker = dice.range(0, 7) as usize;
            let restart_after = dice.range(10, 800);
            let for_ms = dice.range(20, 1_500);
            let role = dice.pick(&Role::ALL);
            let iteration = dice.range(0, u64::from(script.outline.spec.iterations()) - 1) as u32;
            let moment = dice.pick(&[Moment::Before, Moment::Middle, Moment::After]);
            script.mishaps.push(match dice.range(0, 8) {
                0 => Mishap::Kill { at, worker, restart_after },
                1 | 2 => Mishap::KillAtWork { role, iteration, moment, times: 1 },
                3 => Mishap::Hang { at, worker, for_ms },
                4 => Mishap::HangAtWork { role, iteration, for_ms },
                5 => Mishap::Partition { at, mask: dice.next() as u32, for_ms },
                6 => Mishap::KillOrchestrator { at, restart_after },
                7 => Mishap::SecondOrchestrator { at, deaf: dice.chance(0.5) },
                _ => Mishap::Drain { at, worker, restart_after },
            });
        }
        script
    }
}
