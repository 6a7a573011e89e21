//! `top`: members and runs of a fleet, looked at again each second.

use std::collections::{BTreeMap, BTreeSet};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use ds_process::security::Control;
use ds_process::terminal::{answer, unread};
use ds_wire::control as pb;
use pb::fleet_client::FleetClient;
use pb::runs_client::RunsClient;
use serde_json::json;

use crate::cli::TopArgs;

/// How long a member that went is still shown.
const GONE_FOR: Duration = Duration::from_secs(60);
/// The newest runs are shown, and no more.
const MOST_RUNS: u32 = 20;
/// Puts the cursor to the upper left and clears what is there.
const CLEAR: &str = "\u{1b}[H\u{1b}[2J";

/// A run with its episodes counted.
#[derive(Clone)]
struct Counted {
    id: String,
    status: &'static str,
    episodes: usize,
    by_status: BTreeMap<&'static str, usize>,
    frames_per_second: f64,
    /// What drives under way wait for.
    awaits: Vec<String>,
}

impl Counted {
    fn of(run: pb::Run) -> Self {
        let mut by_status = BTreeMap::new();
        let (mut frames_per_second, mut awaits) = (0.0, Vec::new());
        for episode in &run.episodes {
            *by_status.entry(pb::status_name(episode.status)).or_default() += 1;
            if episode.status == i32::from(pb::Status::Running) {
                frames_per_second += episode.frames_per_second;
                awaits.extend((!episode.awaits.is_empty()).then(|| format!("{}: {}", episode.episode, episode.awaits)));
            }
        }
        let (status, episodes) = (pb::status_name(run.status), run.episodes.len());
        Self { id: run.run_id, status, episodes, by_status, frames_per_second, awaits }
    }
}

/// One look at a fleet.
struct Look {
    members: Vec<pb::Instance>,
    runs: Vec<Counted>,
}

/// Looks at a fleet; `ended` keeps runs that change no more, so that each is asked for once.
async fn look(channel: &Control, ended: &mut BTreeMap<String, Counted>) -> Result<Look> {
    let mut fleet = FleetClient::new(channel.clone());
    let mut runs = RunsClient::new(channel.clone());
    let members = fleet.list(pb::ListInstancesRequest {}).await.context("orchestrator")?.into_inner().instances;
    let mut counted = Vec::new();
    for run in runs.list(pb::ListRequest { limit: MOST_RUNS }).await.context("orchestrator")?.into_inner().runs {
        if let Some(known) = ended.get(&run.run_id) {
            counted.push(known.clone());
            continue;
        }
        let whole = runs.get(pb::GetRequest { run_id: run.run_id.clone() }).await.context("orchestrator")?.into_inner();
        let over = pb::has_ended(whole.status);
        let one = Counted::of(whole);
        if over {
            ended.insert(run.run_id, one.clone());
        }
        counted.push(one);
    }
    Ok(Look { members, runs: counted })
}

/// Runs the command.
///
/// # Errors
/// If the orchestrator does not answer.
pub(crate) async fn run(args: &TopArgs) -> Result<()> {
    let channel = args.control.dial()?.connect(Duration::from_secs(5)).await;
    let channel = channel.with_context(|| format!("orchestrator does not answer: {}", args.control.orchestrator))?;
    let mut gone: BTreeMap<String, Instant> = BTreeMap::new();
    let mut before: BTreeSet<String> = BTreeSet::new();
    let mut ended = BTreeMap::new();
    let mut second = tokio::time::interval(Duration::from_secs(1));
    loop {
        second.tick().await;
        let look = look(&channel, &mut ended).await?;
        let here: BTreeSet<String> = look.members.iter().map(|member| hello(member).0.to_owned()).collect();
        gone.extend(before.difference(&here).map(|name| (name.clone(), Instant::now())));
        gone.retain(|name, since| !here.contains(name) && since.elapsed() < GONE_FOR);
        before = here;
        if args.json {
            answer(&told(&look, &gone).to_string());
        } else {
            let clear = if !args.once && std::io::stdout().is_terminal() { CLEAR } else { "" };
            answer(&format!("{clear}{}", table(&look, &gone)));
        }
        if args.once || unread() {
            return Ok(());
        }
    }
}

/// Returns name, role and slots of a member.
fn hello(member: &pb::Instance) -> (&str, &'static str, u32) {
    let Some(hello) = &member.hello else { return ("?", "?", 0) };
    (&hello.instance, pb::role_of(hello.role).map_or("?", ds_topic::Role::name), hello.slots)
}

fn told(look: &Look, gone: &BTreeMap<String, Instant>) -> serde_json::Value {
    let member = |member: &pb::Instance| {
        let (instance, role, slots) = hello(member);
        let holds: Vec<&str> = member.holds.iter().map(|held| held.episode.as_str()).collect();
        json!({ "instance": instance, "role": role, "slots": slots, "holds": holds, "device": member.device,
            "silent_ms": member.silent_millis, "state": pb::member_state(member) })
    };
    let run = |run: &Counted| {
        json!({ "run": run.id, "status": run.status, "episodes": run.episodes, "by_status": run.by_status,
            "frames_per_second": run.frames_per_second, "awaits": run.awaits })
    };
    json!({
        "members": look.members.iter().map(member).collect::<Vec<_>>(),
        "gone": gone.keys().collect::<Vec<_>>(),
        "runs": look.runs.iter().map(run).collect::<Vec<_>>(),
    })
}

fn table(look: &Look, gone: &BTreeMap<String, Instant>) -> String {
    let mut lines =
        vec![format!("{:<36} {:<8} {:>9} {:>9}  {:<14} {}", "member", "role", "holds", "silent s", "state", "device")];
    for member in &look.members {
        let (instance, role, slots) = hello(member);
        let (holds, silent_secs) = (format!("{} of {slots}", member.holds.len()), member.silent_millis as f64 / 1e3);
        lines.push(format!(
            "{instance:<36} {role:<8} {holds:>9} {silent_secs:>9.1}  {:<14} {}",
            pb::member_state(member),
            member.device
        ));
    }
    for (instance, since) in gone {
        lines.push(format!(
            "{instance:<36} went {} s ago: its episodes are driven on by others",
            since.elapsed().as_secs()
        ));
    }
    lines.push(String::new());
    lines.push(format!(
        "{:<40} {:<10} {:>8} {:>8} {:>9}  {}",
        "run", "status", "episodes", "running", "frames/s", "ended"
    ));
    for run in &look.runs {
        let ended = run.by_status.iter().filter(|(status, _)| !["queued", "running"].contains(*status));
        let ended: Vec<String> = ended.map(|(status, number)| format!("{number} {status}")).collect();
        let running = run.by_status.get("running").copied().unwrap_or_default();
        let (total, rate) = (run.episodes, run.frames_per_second);
        lines.push(format!(
            "{:<40} {:<10} {total:>8} {running:>8} {rate:>9.1}  {}",
            run.id,
            run.status,
            ended.join(", ")
        ));
        lines.extend(run.awaits.iter().map(|awaits| format!("  {awaits}")));
    }
    lines.join("\n")
}
