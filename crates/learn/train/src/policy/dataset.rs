//! Samples: a reference-camera frame, the speed and the command, and the teacher's poses from there.
//!
//! Kept as 8-bit pixels in one file per set: a line of magic, a count, then fixed-size records, little-endian.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use ds_camera::{Appearance, ReferenceCamera, SceneCamera};
use ds_graph::planner::{HEIGHT_PX, WIDTH_PX};
use ds_nn::team::Team;
use ds_policy::camera::eye::Eye;
use ds_policy::camera::proposals::{KNOT_SECS, KNOTS, TARGETS};
use ds_policy::driver::Driver;
use ds_scenario::{Family, generate};
use ds_sim::{SimConfig, Simulation};
use ds_space::{DVec2, Draws, PoseSe2, Tick};
use ds_world::{EgoState, RouteCommand, Scene, WorldState};

use super::settings::PolicySettings;
use super::{FIRST_HELD_OUT_SEED, PolicyTrainError};

const MAGIC: &[u8; 16] = b"ds policy data 2";
const PIXELS: usize = WIDTH_PX * HEIGHT_PX * 3;
/// Numbers of a record: speed, yaw rate, acceleration, then the teacher's poses.
const NUMBERS: usize = 4 + TARGETS;
const RECORD_BYTES: usize = PIXELS + 4 * NUMBERS + 4 + 8 + 4 + 8 * 3;
/// The longest file of samples that is read, in bytes.
const MAX_BYTES: u64 = 8 << 30;
/// The draw of a state's look.
const LOOK: u64 = 9;
/// The last tick from which the tracks reach to the end of a label.
const LAST_START_TICK: u64 = 110;

/// Which scenarios are shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScenarioSplit {
    /// Those for training.
    Training,
    /// Those held out.
    HeldOut,
}

/// Where a sample was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// The scenario, as in [`Stage::new`].
    pub(super) scenario: u64,
    pub(super) tick: Tick,
    pub(super) pose: PoseSe2,
}

/// A state with its label.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sample {
    /// The frame as the network's own camera sees it, rows of 8-bit RGB.
    pub(super) rgb: Vec<u8>,
    pub(super) speed_mps: f32,
    pub(super) yaw_rate_radps: f32,
    pub(super) acceleration_mps2: [f32; 2],
    pub(super) command: RouteCommand,
    pub(super) place: Place,
    /// The teacher's poses in the rig at now: x, y, heading of each knot.
    pub(super) knots: [f32; TARGETS],
}

impl Sample {
    /// Reads one record; says what it holds that it must not.
    fn parse(record: &[u8]) -> Result<Self, String> {
        let (rgb, rest) = record.split_at(PIXELS);
        let (numbers, rest) = rest.split_at(4 * NUMBERS);
        let number = |k: usize| f32::from_le_bytes(numbers[4 * k..4 * k + 4].try_into().expect("four bytes"));
        let bits = |at: usize| u64::from_le_bytes(rest[at..at + 8].try_into().expect("eight bytes"));
        let word = |at: usize| u32::from_le_bytes(rest[at..at + 4].try_into().expect("four bytes"));
        let command = match word(0) {
            0 => RouteCommand::Straight,
            1 => RouteCommand::Left,
            2 => RouteCommand::Right,
            other => return Err(format!("command {other}")),
        };
        let pose = [16, 24, 32].map(|at| f64::from_bits(bits(at)));
        if (0..NUMBERS).any(|k| !number(k).is_finite()) || pose.iter().any(|value| !value.is_finite()) {
            return Err("a number that is not finite".to_owned());
        }
        Ok(Self {
            rgb: rgb.to_vec(),
            speed_mps: number(0),
            yaw_rate_radps: number(1),
            acceleration_mps2: [number(2), number(3)],
            knots: std::array::from_fn(|k| number(4 + k)),
            command,
            place: Place { scenario: bits(4), tick: Tick(word(12)), pose: PoseSe2::new(pose[0], pose[1], pose[2]) },
        })
    }

    /// Returns the teacher's poses.
    pub(super) fn poses(&self) -> [PoseSe2; KNOTS] {
        let at = |k: usize| f64::from(self.knots[k]);
        std::array::from_fn(|k| PoseSe2::new(at(3 * k), at(3 * k + 1), at(3 * k + 2)))
    }
}

/// A set of samples.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Samples(pub(super) Vec<Sample>);

impl Samples {
    /// Joins those of several scenarios.
    pub(super) fn joined(made: Vec<Result<Vec<Sample>, PolicyTrainError>>) -> Result<Self, PolicyTrainError> {
        let made: Result<Vec<Vec<Sample>>, _> = made.into_iter().collect();
        Ok(Self(made?.into_iter().flatten().collect()))
    }

    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    pub(super) fn append(&mut self, mut other: Self) {
        self.0.append(&mut other.0);
    }

    /// Reads the set from its file, or makes it and writes the file.
    pub(super) fn held(
        path: &Path,
        make: impl FnOnce() -> Result<Self, PolicyTrainError>,
    ) -> Result<Self, PolicyTrainError> {
        if path.exists() {
            return Self::read(path);
        }
        let samples = make()?;
        samples.write(path)?;
        Ok(samples)
    }

    pub(super) fn write(&self, path: &Path) -> Result<(), PolicyTrainError> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend((self.0.len() as u64).to_le_bytes());
        for sample in &self.0 {
            bytes.extend_from_slice(&sample.rgb);
            let motion = [sample.speed_mps, sample.yaw_rate_radps].into_iter().chain(sample.acceleration_mps2);
            bytes.extend(motion.chain(sample.knots).flat_map(f32::to_le_bytes));
            bytes.extend((sample.command as u32).to_le_bytes());
            let Place { scenario, tick, pose } = sample.place;
            bytes.extend(scenario.to_le_bytes());
            bytes.extend(tick.0.to_le_bytes());
            bytes.extend([pose.position.x, pose.position.y, pose.heading_rad].into_iter().flat_map(f64::to_le_bytes));
        }
        let partial = path.with_extension("partial");
        let written = fs::write(&partial, bytes).and_then(|()| fs::rename(&partial, path));
        written.map_err(|source| PolicyTrainError::Io { doing: "written", path: path.display().to_string(), source })
    }

    pub(super) fn read(path: &Path) -> Result<Self, PolicyTrainError> {
        let io = |source| PolicyTrainError::Io { doing: "read", path: path.display().to_string(), source };
        let bad = |problem: String| PolicyTrainError::Samples { path: path.display().to_string(), problem };
        let length = fs::metadata(path).map_err(io)?.len();
        if length > MAX_BYTES {
            return Err(bad(format!("has {length} bytes, the limit is {MAX_BYTES}")));
        }
        let bytes = fs::read(path).map_err(io)?;
        let records = bytes.strip_prefix(MAGIC).ok_or_else(|| bad("does not begin as a samples file".into()))?;
        let (count, records) = records.split_first_chunk().ok_or_else(|| bad("ends before its count".into()))?;
        let count = u64::from_le_bytes(*count);
        if count.checked_mul(RECORD_BYTES as u64) != Some(records.len() as u64) {
            return Err(bad(format!("claims {count} samples and holds {} bytes of them", records.len())));
        }
        let parse = |(index, record): (usize, &[u8])| {
            Sample::parse(record).map_err(|problem| bad(format!("holds {problem} in sample {index}")))
        };
        records.chunks_exact(RECORD_BYTES).enumerate().map(parse).collect::<Result<_, _>>().map(Self)
    }
}

fn seed_of(shown: ScenarioSplit, index: u64) -> u64 {
    let first = match shown {
        ScenarioSplit::Training => 0,
        ScenarioSplit::HeldOut => FIRST_HELD_OUT_SEED,
    };
    first + index / Family::ALL.len() as u64
}

/// Makes the scene of scenario `index`.
pub(super) fn scene(shown: ScenarioSplit, index: u64) -> Scene {
    #[expect(clippy::cast_possible_truncation, reason = "below the number of families")]
    let family = Family::ALL[(index % Family::ALL.len() as u64) as usize];
    generate(family, seed_of(shown, index))
}

/// A generated scenario with its teacher and its camera.
pub(super) struct Stage {
    index: u64,
    pub(super) scene: Arc<Scene>,
    pub(super) driver: Driver,
    camera: ReferenceCamera,
    eye: Eye,
}

impl Stage {
    /// Makes scenario `index` of the training or the held-out seeds; the families take turns, the look is drawn.
    pub(super) fn new(shown: ScenarioSplit, index: u64) -> Self {
        let scene = Arc::new(scene(shown, index));
        let families = Family::ALL.len() as u64;
        let look = Draws::from_seed(seed_of(shown, index), "policy appearance").u64(index % families);
        let camera = ReferenceCamera::new(&scene, Appearance::from_seed(look));
        Self { index, driver: Driver::new(&scene), camera, scene, eye: Eye::default() }
    }

    /// Draws the look anew: light, weather, paints and textures, so that a policy cannot take those of a scene for its road.
    pub(super) fn look_otherwise(&mut self, draws: &Draws) {
        self.camera = ReferenceCamera::new(&self.scene, Appearance::from_seed(draws.u64(LOOK)));
    }

    /// Returns the frame of the scene's first camera.
    pub(super) fn frame(&self, world: &WorldState) -> Result<ds_raster::RgbImage, PolicyTrainError> {
        let seen = self.camera.on_ego(world, &self.scene.cameras[0]);
        seen.map_err(|source| PolicyTrainError::Frame { name: self.scene.name.clone(), source })
    }

    /// Returns a world of this scene as a labelled sample.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "samples are single precision, ticks few"
    )]
    pub(super) fn sample(&mut self, world: &WorldState, frame: &ds_raster::RgbImage, command: RouteCommand) -> Sample {
        let every = (KNOT_SECS / self.scene.dt.secs()).round().max(1.0) as usize;
        let driven = self.driver.drive(&world.ego, world.tick, (every * KNOTS) as u32);
        let mut knots = [0.0; TARGETS];
        for (pose, knot) in driven.iter().skip(every - 1).step_by(every).zip(knots.chunks_exact_mut(3)) {
            let local = world.ego.pose.relative(pose);
            let numbers = [local.position.x, local.position.y, local.heading_rad];
            knot.iter_mut().zip(numbers).for_each(|(knot, number)| *knot = number as f32);
        }
        let rgb = self.eye.look(&self.scene.cameras[0], frame).rgb().to_vec();
        let acceleration = world.ego.acceleration_mps2;
        Sample {
            rgb,
            speed_mps: world.ego.speed_mps() as f32,
            yaw_rate_radps: world.ego.yaw_rate_radps as f32,
            acceleration_mps2: [acceleration.x as f32, acceleration.y as f32],
            command,
            place: Place { scenario: self.index, tick: world.tick, pose: world.ego.pose },
            knots,
        }
    }

    /// Starts a simulation at a tick of the log.
    pub(super) fn simulation(&self, config: SimConfig, start: Tick) -> Result<Simulation, PolicyTrainError> {
        let name = self.scene.name.clone();
        Simulation::new(self.scene.clone(), config, start)
            .map_err(|source| PolicyTrainError::Simulation { name, source })
    }
}

/// Makes samples of the expert's drives and of states beside them.
pub(super) fn beside_the_expert(settings: &PolicySettings, shown: ScenarioSplit) -> Result<Samples, PolicyTrainError> {
    let scenarios = match shown {
        ScenarioSplit::Training => settings.scenarios,
        ScenarioSplit::HeldOut => settings.held_out_scenarios,
    };
    let made = Team::of_all_cores().run(scenarios as usize, |index| {
        let (mut stage, mut samples) = (Stage::new(shown, index as u64), Vec::new());
        for state in 0..u64::from(settings.states_per_scenario) {
            let draws = Draws::new(&stage.scene.digest, "policy states", &[settings.seed, state]);
            #[expect(clippy::cast_possible_truncation, reason = "below the last start tick")]
            let tick = Tick(draws.below(0, LAST_START_TICK + 1) as u32);
            let config = SimConfig { agents: None, ..SimConfig::default() };
            let simulation = stage.simulation(config, tick)?;
            let mut world = simulation.state().clone();
            world.ego = moved(settings, &stage.driver, &world.ego, &draws);
            if !touches(&world, &stage.scene) {
                stage.look_otherwise(&draws);
                let frame = stage.frame(&world)?;
                samples.push(stage.sample(&world, &frame, simulation.route_command()));
            }
        }
        Ok(samples)
    });
    Samples::joined(made)
}

/// Moves a logged state: one in five stays, the others are shifted along and across the route, turned, and given
/// another speed.
fn moved(settings: &PolicySettings, driver: &Driver, logged: &EgoState, draws: &Draws) -> EgoState {
    if draws.uniform(1) < 0.2 {
        return *logged;
    }
    let spread = |index: u64, most: f64| (0.45 * most * draws.normal(index)).clamp(-most, most);
    let route = driver.route();
    let along_m = route.project_pose(&logged.pose).along_m + if draws.uniform(2) < 0.5 { spread(3, 6.0) } else { 0.0 };
    let pose =
        route.pose(along_m).compose(&PoseSe2::new(0.0, spread(4, settings.lateral_m), spread(5, settings.heading_rad)));
    let speed_mps = match draws.uniform(6) {
        share if share < 0.2 => draws.range(7, 0.0, 14.0),
        share if share < 0.4 => logged.speed_mps(),
        _ => (logged.speed_mps() * (1.0 + 0.15 * draws.normal(7)) + 0.4 * draws.normal(8)).max(0.0),
    };
    EgoState { pose, velocity_mps: DVec2::new(speed_mps, 0.0), ..*logged }
}

/// Says whether the ego stands in (or within a hand of) another's box: such states teach nothing.
fn touches(world: &WorldState, scene: &Scene) -> bool {
    let body = world.ego.centre(&scene.vehicle);
    let half = 0.5 * DVec2::new(scene.vehicle.size.length_m, scene.vehicle.size.width_m) + DVec2::splat(0.1);
    world.agents.iter().any(|agent| {
        let inside = |corner: DVec2| body.to_local(corner).abs().cmplt(half).all();
        let others = 0.5 * DVec2::new(agent.size.length_m, agent.size.width_m) + DVec2::splat(0.1);
        let corners = world.ego.corners(&scene.vehicle);
        agent.corners().into_iter().any(inside)
            || inside(agent.pose.position)
            || corners.into_iter().any(|corner| agent.pose.to_local(corner).abs().cmplt(others).all())
    })
}
