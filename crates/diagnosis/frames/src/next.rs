//! What to record next to tell the two best hypotheses apart, by expected log Bayes factor: each recording of a small
//! library is drawn as plain pictures, sent through both hypotheses, and half the squared difference is weighed by the
//! noise of a usual case.

use ds_diagnosis::schema::Manoeuvre;
use ds_effect::FrameChain;
use ds_effect::frame::{FrameContext, LayoutBox, Pinhole};
use ds_effect::picture::Picture;
use ds_space::draw::Draws;

use crate::geometry::Chosen;
use crate::scene::Scene;
use crate::search::Search;
use crate::settings;

/// A recording that might be made.
struct Recording {
    name: &'static str,
    secs: f64,
    draw: Texture,
    speed_mps: f64,
    yaw_rate_radps: f64,
    /// Factor of the light in the middle third.
    light: f64,
    depth_m: Option<f64>,
    anchored: bool,
}

#[derive(Clone, Copy)]
enum Texture {
    Squares,
    Plain,
    Fine,
    Road,
}

const STILL: Recording = Recording {
    name: "",
    secs: 5.0,
    draw: Texture::Road,
    speed_mps: 0.0,
    yaw_rate_radps: 0.0,
    light: 1.0,
    depth_m: None,
    anchored: true,
};

const RECORDINGS: [Recording; 7] = [
    Recording { name: "checkerboard filling the picture", draw: Texture::Squares, depth_m: Some(3.0), ..STILL },
    Recording { name: "straight road at two distances", secs: 20.0, speed_mps: 8.0, ..STILL },
    Recording { name: "grey card under even light", draw: Texture::Plain, depth_m: Some(2.0), ..STILL },
    Recording { name: "tunnel entry and exit", secs: 20.0, speed_mps: 15.0, light: 0.1, ..STILL },
    Recording { name: "slalom at constant speed", secs: 20.0, speed_mps: 12.0, yaw_rate_radps: 0.4, ..STILL },
    Recording {
        name: "standing still before fine texture",
        secs: 10.0,
        draw: Texture::Fine,
        depth_m: Some(8.0),
        ..STILL
    },
    Recording { name: "long rollout without re-anchoring", secs: 30.0, speed_mps: 8.0, anchored: false, ..STILL },
];

/// Frames drawn of each recording.
const FRAMES: u64 = 9;
/// Size of the drawn pictures, px.
const SIZE: [usize; 2] = [104, 64];
/// Share of pixels that count as independent, over the variance of a usual case, 1/levels².
const WEIGHT: f64 = 0.01 / settings::USUAL_NOISE;
/// Largest factor that is told.
const MOST: f64 = 1e4;

/// Returns the two recordings that tell most between the two best hypotheses of the last decided round.
#[must_use]
pub fn manoeuvres(scene: &Scene<'_>, found: &Search) -> Vec<Manoeuvre> {
    let Some(round) = found.rounds.get(found.chosen.len().saturating_sub(1)) else { return Vec::new() };
    let Some(first) = round.trials.first() else { return Vec::new() };
    let second = round.trials.get(1);
    let none = Vec::new();
    let (a, b) = (&first.model.effects, second.map_or(&none, |t| &t.model.effects));
    let mut list: Vec<(f64, &Recording)> = RECORDINGS.iter().map(|r| (told(scene, r, a, b), r)).collect();
    list.sort_by(|x, y| y.0.total_cmp(&x.0));
    list.into_iter()
        .take(2)
        .filter(|(told, _)| *told > 0.01)
        .map(|(told, r)| Manoeuvre {
            name: r.name.to_owned(),
            separates: [first.id.to_owned(), second.map_or("none", |t| t.id).to_owned()],
            expected_log_bayes_factor: told,
            secs_needed: r.secs * (5.0 / told).clamp(0.05, 20.0),
        })
        .collect()
}

fn told(scene: &Scene<'_>, recording: &Recording, a: &Chosen, b: &Chosen) -> f64 {
    let (mut one, mut other) = (FrameChain::new(a), FrameChain::new(b));
    let depth = depth(scene, recording);
    let boxes = [LayoutBox { edges: [40.0, 26.0, 64.0, 46.0], class: "car".to_owned() }];
    let mut sum = 0.0;
    for k in 0..FRAMES {
        let middle = (FRAMES / 3..2 * FRAMES / 3).contains(&k);
        let context = FrameContext {
            frame: k,
            time_secs: 0.1 * k as f64,
            frames_since_anchor: if recording.anchored { (k % 4) as f64 } else { 12.0 * k as f64 },
            speed_mps: Some(recording.speed_mps),
            yaw_rate_radps: Some(recording.yaw_rate_radps * if k % 2 == 0 { 1.0 } else { -1.0 }),
            light: if middle { recording.light } else { 1.0 },
            depth_m: Some(&depth),
            boxes: &boxes,
            camera: camera(scene),
            size: SIZE,
            sensor_rows: scene.case.sensor_rows,
            seed: 1,
        };
        let picture = drawn(recording, k);
        let (p, q) = (one.next(&picture, &context), other.next(&picture, &context));
        // what one frame's brightness and noise may do anyway is no difference
        let square = |(p, q): (&f32, &f32)| f64::from((p - q).powi(2));
        sum += p.data.iter().zip(&q.data).map(square).sum::<f64>();
    }
    let seconds = recording.secs / (0.1 * FRAMES as f64);
    (0.5 * WEIGHT * sum * seconds.sqrt()).min(MOST)
}

fn camera(scene: &Scene<'_>) -> Pinhole {
    let c = scene.case.camera;
    let share = SIZE[0] as f64 / scene.case.size[0] as f64;
    Pinhole { fx: c.fx * share, fy: c.fy * share, cx: SIZE[0] as f64 / 2.0, cy: SIZE[1] as f64 * 0.45 }
}

fn depth(scene: &Scene<'_>, recording: &Recording) -> Vec<f32> {
    let camera = camera(scene);
    let road = |k: usize| {
        let down = ((k / SIZE[0]) as f64 - camera.cy) / camera.fy;
        (if down > 0.0 { (1.5 / down).min(100.0) } else { 100.0 }) as f32
    };
    (0..SIZE[0] * SIZE[1]).map(|k| recording.depth_m.map_or_else(|| road(k), |d| d as f32)).collect()
}

fn drawn(recording: &Recording, frame: u64) -> Picture {
    let mut picture = Picture::filled(SIZE[0], SIZE[1], 3, 120.0);
    let draws = Draws::from_seed(5, "recording");
    let along = (recording.speed_mps * frame as f64) as usize;
    for (k, value) in picture.data.iter_mut().enumerate() {
        let (x, y) = (k / 3 % SIZE[0], k / 3 / SIZE[0]);
        let grain = draws.uniform((((y + along) % 97) * SIZE[0] + x) as u64);
        *value = match recording.draw {
            Texture::Squares => [40.0, 215.0][(x / 8 + y / 8) % 2],
            Texture::Plain => 128.0,
            Texture::Fine => (60.0 + 140.0 * grain) as f32,
            Texture::Road if 2 * y < SIZE[1] => 205.0 - (y as f32),
            Texture::Road => (70.0 + 60.0 * grain) as f32,
        };
    }
    picture
}
