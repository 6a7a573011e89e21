//! The sim stage: one simulator per episode, moved by the plan or the log, one `world` and `ego` per tick.

use std::sync::Arc;

use ds_oracle::{AgentsIn, Oracle};
use ds_process::maker::{Fault, Inputs, Maker, MakerFactory, Output, bad, output};
use ds_sim::{SimConfig, Simulation};
use ds_space::{Digest, Tick};
use ds_topic::{Advance, Ego, Motion, ProposalScorer, Role, SceneMessage, Slot, Topic, Verdict, World};
use ds_world::Proposal;

/// Opens a simulator for each episode that the instance is given.
#[derive(Debug, Default)]
pub struct SimStage;

impl MakerFactory for SimStage {
    fn role(&self) -> Role {
        Role::Sim
    }

    fn compute_class(&self) -> String {
        format!("sim {}", std::env::consts::ARCH)
    }

    fn open(&self, scene: Arc<SceneMessage>) -> Result<Box<dyn Maker>, Fault> {
        let config = SimConfig::of_episode(&scene.spec).map_err(|error| bad("bad_settings", &error))?;
        Ok(Box::new(Running {
            scene,
            config,
            simulation: None,
            border: Digest::default(),
            verdict: None,
            oracle: None,
        }))
    }
}

struct Running {
    scene: Arc<SceneMessage>,
    config: SimConfig,
    simulation: Option<Simulation>,
    border: Digest,
    /// How the proposals of the order under way were ranked, until its first state carries it.
    verdict: Option<Verdict>,
    oracle: Option<Oracle>,
}

impl Running {
    fn outputs(&mut self, with_snapshot: bool) -> Result<[Output; 2], Fault> {
        let simulation = self
            .simulation
            .as_ref()
            .ok_or_else(|| Fault::deterministic("no_simulator", "an order came before the initial one"))?;
        let world = World {
            state: simulation.state().clone(),
            before: self.border,
            snapshot: with_snapshot.then(|| simulation.snapshot()),
            verdict: self.verdict.take(),
            readings: simulation.readings(&self.scene.spec.draw_key()),
        };
        let ego = Ego { estimate: simulation.ego_estimate(), command: simulation.route_command() };
        let tick = world.state.tick;
        let world = output(Slot::new(Topic::World, tick.0), tick, &world);
        self.border = world.content;
        Ok([world, output(Slot::new(Topic::Ego, tick.0), tick, &ego)])
    }
}

impl Maker for Running {
    fn restore(&mut self, order: &Advance, inputs: &Inputs) -> Result<(), Fault> {
        let Some(before) = order.first.previous().filter(|_| order.iteration > 0) else {
            return Ok(());
        };
        let slot = Slot::new(Topic::World, before.0);
        let world: World = inputs.decode(slot)?;
        let snapshot =
            world.snapshot.ok_or_else(|| Fault::deterministic("missing_input", format!("{slot} has no snapshot")))?;
        let restored = Simulation::restore(Arc::clone(&self.scene.scene), self.config.clone(), &snapshot);
        self.simulation = Some(restored.map_err(|error| bad("snapshot_refused", &error))?);
        self.border = inputs.content(slot)?;
        Ok(())
    }

    fn work(&mut self, order: &Advance, _inputs: &Inputs) -> Result<Vec<Output>, Fault> {
        match &order.motion {
            Motion::Initial => {
                let started = Simulation::new(Arc::clone(&self.scene.scene), self.config.clone(), Tick(0));
                self.simulation = Some(started.map_err(|error| bad("scenario_refused", &error))?);
                return Ok(self.outputs(true)?.into());
            }
            Motion::Log => self.running()?.begin_log(),
            Motion::Plan(plan) => self.running()?.begin_plan(plan),
            Motion::Choice(proposals) => self.choose(proposals)?,
        }
        let mut outputs = Vec::new();
        for tick in order.first.to(order.last) {
            self.running()?.step();
            outputs.extend(self.outputs(tick == order.last)?);
        }
        Ok(outputs)
    }
}

impl Running {
    /// Ranks the proposals in copies of the world and begins the best one.
    fn choose(&mut self, proposals: &[Proposal]) -> Result<(), Fault> {
        let simulation = self.running()?.clone();
        let oracle = match &mut self.oracle {
            Some(oracle) => oracle,
            None => {
                let made = Oracle::new(&self.scene.scene).map_err(|error| bad("oracle_refused", &error))?;
                self.oracle.insert(made)
            }
        };
        let agents = match self.scene.spec.scorer {
            ProposalScorer::OracleNavsim => AgentsIn::Open,
            ProposalScorer::Learned | ProposalScorer::Oracle => AgentsIn::Reacting,
        };
        let ranked = oracle.rank(&simulation, proposals, agents).map_err(|error| bad("oracle_refused", &error))?;
        let best = &proposals[ranked.chosen].trajectory;
        self.running()?.begin_plan(best);
        self.verdict = Some(Verdict {
            chosen: u32::try_from(ranked.chosen).unwrap_or(u32::MAX),
            scores: ranked.scores,
            reference: ranked.reference,
        });
        Ok(())
    }

    fn running(&mut self) -> Result<&mut Simulation, Fault> {
        self.simulation
            .as_mut()
            .ok_or_else(|| Fault::deterministic("no_simulator", "an order came before the initial one"))
    }
}
