//! What fleet a run asks for.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::PathBuf;

use anyhow::Result;
use ds_policy::Own;
use ds_topic::Role;
use ds_video::Backend;
use ds_world::LayoutBackend;

use crate::networks::Networks;
use crate::own;
use crate::run_plan::RunPlan;

/// No run has more workers.
const MOST_WORKERS: u32 = 64;

/// How the fleet of one run is made up.
#[derive(Debug, Clone)]
pub struct FleetPlan {
    /// Ledger and recordings.
    pub folder: PathBuf,
    /// What makes frames and plans.
    pub networks: Networks,
    /// Manifests of policies of one's own.
    pub manifests: Vec<PathBuf>,
    /// Video workers, and episodes under way at a time.
    pub workers: u32,
    /// The policy under test.
    pub policy: String,
    /// Where it connects to, if it is external.
    pub policy_listen: Option<String>,
    /// Whether layouts may be drawn by a graphics adapter.
    pub probe_adapter: bool,
    /// Share of pushes that are dropped.
    pub drop_pushes: f64,
    /// Commands of other programs that take a stage's place.
    pub stages: BTreeMap<Role, String>,
    /// Whether somebody looks on from another process.
    pub live: bool,
    /// Seconds that video workers only wait for each chunk; 0 where they generate. Only processes can be such.
    pub simulated_secs: f64,
    /// Where Prometheus asks.
    pub metrics: Option<SocketAddr>,
}

impl FleetPlan {
    /// Returns the fleet that the arguments of a run of so many drives ask for.
    ///
    /// # Errors
    /// If a stage is none, has no command, or is named twice; if the manifest of a policy is refused.
    pub fn of(args: &RunPlan, drives: usize) -> Result<Self> {
        let mut stages = BTreeMap::new();
        for text in &args.stages {
            let named =
                text.split_once('=').and_then(|(role, command)| Some((Role::from_name(role.trim())?, command.trim())));
            let Some((role, command)) = named.filter(|(_, command)| !command.is_empty()) else {
                anyhow::bail!("--stage {text:?} is not ROLE=COMMAND with sim, layout, video or policy as ROLE");
            };
            anyhow::ensure!(stages.insert(role, command.to_owned()).is_none(), "--stage names {role} twice");
        }
        // One at a time where others drive along, or all workers would share one device.
        let own = args.policy_listen.is_none() && stages.is_empty() && args.networks.video_backend == Backend::Cpu;
        let asked = args.workers.or((!own).then_some(1));
        Ok(Self {
            folder: args.out.clone(),
            networks: args.networks.clone(),
            manifests: Own::named(&args.policy).into_iter().collect(),
            workers: workers(asked, drives),
            policy: own::name(&args.policy)?,
            policy_listen: args.policy_listen.clone(),
            probe_adapter: args.layout_backend != LayoutBackend::Cpu,
            drop_pushes: args.drop_pushes,
            stages,
            live: args.live.is_some(),
            simulated_secs: 0.0,
            metrics: args.metrics,
        })
    }
}

/// Returns how many episodes of so many to drive at a time: as asked, else one for each core that serves this process.
#[must_use]
pub fn workers(asked: Option<u32>, drives: usize) -> u32 {
    let served = || std::thread::available_parallelism().map_or(1, std::num::NonZero::get).min(drives);
    asked.unwrap_or_else(|| u32::try_from(served()).unwrap_or(1)).clamp(1, MOST_WORKERS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_as_asked_else_as_cores_serve_and_drives_need() {
        assert_eq!([workers(Some(3), 1), workers(Some(0), 9), workers(Some(1000), 9)], [3, 1, 64]);
        assert_eq!([workers(None, 0), workers(None, 1)], [1, 1]);
        assert!((1..=64).contains(&workers(None, 1000)));
    }
}
