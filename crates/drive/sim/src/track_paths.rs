//! What the agents of a scene go by: their paths, the lights that they obey, the lanes beside them, the zones in which
//! they meet. Made once of scene and map; shared by all copies of a simulation and by whoever judges recorded agents.

use ds_effect::plant::{Agents, Chart};
use ds_world::{AgentClass, Scene};

use crate::agent_path::AgentPath;
use crate::conflict::{self, Way, Zone};
use crate::lane_change::Lanes;
use crate::lane_index::LaneIndex;
use crate::signal::{self, SignalStop};

/// Paths, stops, lanes and zones, one entry per track; of zones one more for the ego.
#[derive(Debug, Clone, Default)]
pub struct TrackPaths {
    /// The path of each agent that moves.
    pub paths: Vec<Option<AgentPath>>,
    /// Where each stops at lights.
    pub stops: Vec<Vec<SignalStop>>,
    /// Lanes beside each path; empty where nobody changes lanes.
    pub lanes: Vec<Lanes>,
    /// Where each meets others, the ego last; empty where nobody decides there.
    pub zones: Vec<Vec<Zone>>,
    /// The route of the ego, where there are zones.
    pub ego: Option<AgentPath>,
}

impl TrackPaths {
    /// Makes the paths of a scene and whatever the decisions of its agents need.
    #[must_use]
    pub fn new(scene: &Scene, agents: &Agents, chart: &Chart) -> Self {
        let index = LaneIndex::new(&scene.map);
        let lines = signal::governed_lines(&scene.map, &index);
        let meets = agents.walks || agents.yields;
        let mut ways = Self::default();
        for track in &scene.tracks {
            let walks = meets && track.class == AgentClass::Pedestrian;
            let path = if walks { AgentPath::on_foot(track) } else { AgentPath::of(track, &index) };
            let driven = path.as_ref().filter(|_| !walks);
            let mut stops = driven.map(|path| signal::stops_on(path, &lines)).unwrap_or_default();
            stops.iter_mut().for_each(|stop| stop.along_m += chart.stop_line_shift_m);
            if agents.changes_lanes {
                ways.lanes.push(driven.map(|path| Lanes::of(path, &scene.map, &index)).unwrap_or_default());
            }
            ways.stops.push(stops);
            ways.paths.push(path);
        }
        if meets {
            ways.ego = AgentPath::along(&scene.route);
            ways.zones = ways.meetings(scene, chart.crosswalk_missing);
        }
        ways
    }

    /// Makes paths without stops for agents that keep to their log, where the road differs from the map.
    #[must_use]
    pub(crate) fn logged(scene: &Scene) -> Self {
        let index = LaneIndex::new(&scene.map);
        let paths: Vec<_> = scene.tracks.iter().map(|track| AgentPath::of(track, &index)).collect();
        Self { stops: vec![Vec::new(); paths.len()], paths, ..Self::default() }
    }

    /// Returns paths for nobody.
    #[must_use]
    pub(crate) fn none(tracks: usize) -> Self {
        Self { paths: vec![None; tracks], stops: vec![Vec::new(); tracks], ..Self::default() }
    }

    /// Returns where all meet; `unmarked` treats every place where people cross as a crosswalk.
    #[must_use]
    pub fn meetings(&self, scene: &Scene, unmarked: bool) -> Vec<Vec<Zone>> {
        let on_foot = |index: usize| scene.tracks.get(index).is_some_and(|t| t.class == AgentClass::Pedestrian);
        let count = self.paths.len();
        let agents = self.paths.iter().enumerate().filter_map(|(index, path)| Some((index, path.as_ref()?)));
        let all: Vec<(usize, Way<'_>)> = agents
            .chain(self.ego.as_ref().map(|path| (count, path)))
            .map(|(index, path)| (index, Way::new(path, on_foot(index), &scene.map)))
            .collect();
        let mut zones = vec![Vec::new(); count + 1];
        for (k, (i, a)) in all.iter().enumerate() {
            for (j, b) in &all[k + 1..] {
                for [mine, theirs] in conflict::zones((*i, a), (*j, b), &scene.map, unmarked) {
                    zones[*i].push(mine);
                    zones[*j].push(theirs);
                }
            }
        }
        zones
    }
}
