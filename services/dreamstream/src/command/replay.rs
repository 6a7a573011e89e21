//! `replay`: runs the maker of one service on the inputs of a recording and compares what it makes, slot by slot.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use ds_episode::{Codec, Outline, due};
use ds_process::maker::{Inputs, MakerFactory};
use ds_process::terminal::{answer, bar};
use ds_record::Recording;
use ds_topic::{Advance, Role, SceneMessage, Slot, Topic};
use ds_wire::{Body, WireCodec};

use crate::cli::ReplayArgs;
use crate::command::recording;

/// Replays a service; fails if any output differs from the recorded one.
///
/// # Errors
/// If the recording lacks an input, the service refuses one, or an output differs.
pub(crate) fn run(args: &ReplayArgs) -> Result<()> {
    let recording = recording::open(&args.recording, args.partial)?;
    let factory = factory(args)?;
    let role = factory.role();
    let outline = WireCodec.outline(&recording.scene_envelope().body).context("scene")?;
    let scene = SceneMessage::from_bytes(&recording.scene_envelope().body).context("scene")?;
    let mut maker = factory.open(Arc::new(scene)).map_err(anyhow::Error::new)?;
    let committed = u32::try_from(recording.iterations().count()).unwrap_or(u32::MAX);
    ensure!(args.from_iteration < committed, "--from-iteration {}: {committed} are recorded", args.from_iteration);
    let bar = bar(u64::from(committed - args.from_iteration), "iterations");
    let (mut equal, mut differing) = (0u32, Vec::new());
    for iteration in args.from_iteration..committed {
        let advance: Advance = recording.body(Slot::new(Topic::Advance, iteration))?;
        if iteration == args.from_iteration {
            let needed = due::restore_inputs(&outline, role, &advance);
            maker.restore(&advance, &gather(&recording, &needed)?).map_err(anyhow::Error::new)?;
        }
        for (slot, same) in compare(&recording, &outline, role, &advance, &mut *maker)? {
            if same { equal += 1 } else { differing.push(slot) }
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    answer(&format!("{}: {equal} messages equal, {} differ", args.service, differing.len()));
    match differing.first() {
        None => Ok(()),
        Some(first) => bail!("{} messages differ, the first is {first}", differing.len()),
    }
}

fn factory(args: &ReplayArgs) -> Result<Box<dyn MakerFactory>> {
    Ok(match args.service.as_str() {
        "sim-server" => Box::new(sim_server::SimStage),
        "layout-render" => Box::new(layout_render::LayoutStage { probe: false }),
        "vdm-worker" => Box::new(args.networks.video()),
        "policy-bridge" => {
            let stage = policy_bridge::PolicyStage::new(args.networks.policy_weights.clone(), None);
            Box::new(stage.with_own(&args.manifests)?)
        }
        other => bail!("unknown service {other:?}"),
    })
}

fn gather(recording: &Recording, slots: &[Slot]) -> Result<Inputs> {
    let mut inputs = BTreeMap::new();
    for slot in slots {
        let envelope = recording.get(*slot).with_context(|| format!("the recording lacks {slot}"))?;
        inputs.insert(*slot, envelope.clone());
    }
    Ok(Inputs(inputs))
}

fn compare(
    recording: &Recording,
    outline: &Outline,
    role: Role,
    advance: &Advance,
    maker: &mut dyn ds_process::maker::Maker,
) -> Result<Vec<(Slot, bool)>> {
    let inputs = gather(recording, &due::inputs(outline, role, advance))?;
    let outputs = maker.work(advance, &inputs).map_err(anyhow::Error::new)?;
    let same = |slot| recording.get(slot).map(|envelope| envelope.header.content);
    Ok(outputs.into_iter().map(|output| (output.slot, same(output.slot) == Some(output.content))).collect())
}
