//! How well a policy plans on the frames of a source: PDMS of NAVSIM v1.1 of its plan, in open loop, against the true world.
//!
//! The plan is made of one frame, the car's own motion and the route command at a moment of the log (displaced with the
//! car); agents of the log go on as they did. The reference plan is the scorer's own planner.

use std::sync::Arc;

use ds_raster::RgbImage;
use ds_score::{
    Executed, PlannedPoses, PreparedMap, PreparedScene, ScoreError, log_tracks, navsim_v1_executed, open_loop_map,
    reference_plan, scene_now,
};
use ds_space::CameraModel;
use ds_world::{Scene, WorldState};

use super::moment::Moment;
use super::panel::Member;
use crate::error::EvaluationError;

/// States of a rollout: now and 40 steps of 0.1 s.
const STATES: usize = 41;

/// Scores plans of one scenario at some moments.
pub(crate) struct Scorer {
    scene: Arc<Scene>,
    moments: Vec<Scored>,
}

/// A moment with what a plan there is scored against.
struct Scored {
    moment: Moment,
    prepared: PreparedScene,
    reference: Executed,
}

impl Scorer {
    /// Prepares the moments of some worlds of a scenario.
    pub(crate) fn new(scene: &Arc<Scene>, worlds: Vec<WorldState>) -> Result<Self, EvaluationError> {
        let map = PreparedMap::new(&open_loop_map(scene)).map_err(|source| refused(scene, &source))?;
        let map = Arc::new(map);
        let moment = |world: WorldState| {
            let moment = Moment::new(scene, world)?;
            let world = &moment.world;
            let agents = log_tracks(scene, world.tick, STATES);
            let now = scene_now(scene, world.tick, &[world.ego], agents).expect("there is a state of the ego");
            let prepare = || {
                let prepared = PreparedScene::on(&map, &now)?;
                let reference = reference_plan(&prepared, None)?.plan;
                let reference = prepared.executor().execute(prepared.ego(), &reference)?;
                Ok((prepared, reference))
            };
            let (prepared, reference) = prepare().map_err(|source: ScoreError| refused(scene, &source))?;
            Ok(Scored { moment, prepared, reference })
        };
        let moments = worlds.into_iter().map(moment).collect::<Result<_, EvaluationError>>()?;
        Ok(Self { scene: Arc::clone(scene), moments })
    }

    /// Returns the PDMS of a policy's plans on the frames that are shown for the moments.
    pub(crate) fn pdms(
        &self,
        member: &mut Member,
        camera: &CameraModel,
        frames: &[&RgbImage],
    ) -> Result<Vec<f64>, EvaluationError> {
        self.moments.iter().zip(frames).map(|(scored, frame)| self.score(member, camera, scored, frame)).collect()
    }

    fn score(
        &self,
        member: &mut Member,
        camera: &CameraModel,
        scored: &Scored,
        frame: &RgbImage,
    ) -> Result<f64, EvaluationError> {
        let plan = PlannedPoses::of(&scored.moment.plan(member, camera, frame)?);
        let score = || {
            let prepared = &scored.prepared;
            let states = prepared.executor().execute(prepared.ego(), &plan)?;
            navsim_v1_executed(prepared, &scored.reference, &states)
        };
        Ok(score().map_err(|source| refused(&self.scene, &source))?.pdms)
    }
}

fn refused(scene: &Scene, source: &dyn std::error::Error) -> EvaluationError {
    EvaluationError::config("scenarios", format!("{} cannot be scored: {source}", scene.name))
}
