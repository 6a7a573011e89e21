//! Where the gap lies: channel by agent, by place (50 m tiles) and by time, with a bootstrap over rollouts and control of
//! false discoveries (Benjamini and Hochberg 1995).

use std::collections::BTreeMap;

use ds_diagnosis::schema::{Cell, Regime};
use ds_dynamics::cells::discover;
use ds_dynamics::fit::point_loss;
use ds_effect::Channel;
use ds_stats::normal_tail;

use crate::case::Case;
use crate::model::{Kind, Tag, Traffic};
use crate::rollout::SECS;
use crate::settings::{CLEAN_LOSS, STRIDE_SECS};

/// Fewest residuals of a cell.
const FEWEST: usize = 10;
/// Most cells that are listed.
const MOST: usize = 60;

/// Which residuals a cell holds: by agent, or by place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Key {
    Agent(usize, usize),
    Place(usize, [i64; 2]),
}

/// One start of a rollout within a cell.
struct Part {
    loss: f64,
    square: f64,
    count: f64,
    secs: f64,
}

/// Returns the significant cells, largest first, from the residuals without and with the effects found.
#[must_use]
pub fn cells(case: &Case, model: &Traffic, tags: &[Tag], [before, after]: [&[f64]; 2]) -> Vec<Cell> {
    let mut groups: BTreeMap<(Channel, Key), Vec<Part>> = BTreeMap::new();
    for ((tag, z), left) in tags.iter().zip(before).zip(after).filter(|((_, z), _)| **z != 0.0) {
        let judged = &model.judged[tag.actor];
        let channel = match tag.kind {
            Kind::Place => Channel::FollowerGap,
            Kind::Speed => Channel::FollowerSpeed,
            Kind::Aside => Channel::AgentLateral,
            Kind::Decision => Channel::AgentDecision,
        };
        let recording = judged.actor.recording;
        for key in [Key::Agent(recording, judged.actor.index), Key::Place(recording, tag.place)] {
            let parts = groups.entry((channel, key)).or_default();
            let same = parts.last_mut().filter(|part| part.secs == tag.secs);
            let (loss, square) = match tag.kind {
                Kind::Place | Kind::Speed => (point_loss(*z), z * z),
                // What a decision is worth only the effects can tell that explain it.
                Kind::Aside | Kind::Decision => {
                    let worth = (point_loss(*z) - point_loss(*left)).max(0.0);
                    (worth, 2.0 * worth)
                }
            };
            match same {
                Some(part) => {
                    part.loss += loss;
                    part.square += square;
                    part.count += 1.0;
                }
                None => parts.push(Part { loss, square, count: 1.0, secs: tag.secs }),
            }
        }
    }
    let found = groups.into_iter().filter_map(|((channel, key), parts)| cell(case, channel, key, &parts)).collect();
    let mut cells = discover(found);
    cells.truncate(MOST);
    cells
}

fn cell(case: &Case, channel: Channel, key: Key, parts: &[Part]) -> Option<Cell> {
    let count: f64 = parts.iter().map(|part| part.count).sum();
    let decides = matches!(channel, Channel::AgentDecision | Channel::AgentLateral);
    // decisions are few: one agent's, or three at a place, tell
    let telling = decides && (matches!(key, Key::Agent(..)) || count >= 3.0);
    if (count as usize) < FEWEST && !telling {
        return None;
    }
    let means: Vec<f64> = parts.iter().map(|part| part.loss / part.count).collect();
    let mean = parts.iter().map(|part| part.loss).sum::<f64>() / count;
    let rollouts = parts.len() as f64;
    // Rollouts overlap: neighbours share most of what they show.
    let independent = (rollouts * STRIDE_SECS / SECS).max(1.0);
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / rollouts;
    let error = (variance / independent).sqrt().max(0.3 / independent.sqrt());
    let p = normal_tail((mean - CLEAN_LOSS) / error);
    let effect_size = (parts.iter().map(|part| part.square).sum::<f64>() / count).sqrt();
    let mut t: Vec<[f64; 2]> = Vec::new();
    for part in parts.iter().filter(|part| part.loss / part.count > 2.0 * CLEAN_LOSS) {
        match t.last_mut() {
            Some(span) if span[1] >= part.secs && span[0] <= part.secs => span[1] = part.secs + SECS,
            _ => t.push([part.secs, part.secs + SECS]),
        }
    }
    let mut regime = Regime::default();
    match key {
        Key::Agent(recording, agent) => {
            let recorded = &case.recordings[recording];
            regime.drive = recording;
            regime.agent = Some(recorded.scene.tracks.get(agent).map_or_else(|| "ego".to_owned(), |t| t.name.clone()));
            regime.class = Some(format!("{:?}", recorded.agents[agent].class).to_lowercase());
        }
        Key::Place(recording, tile) => {
            regime.drive = recording;
            regime.place = Some(tile);
        }
    }
    Some(Cell { channel: channel.name().to_owned(), regime, effect_size, q_value: Some(p), t })
}
