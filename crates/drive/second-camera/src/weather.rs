//! Snow, sand and water of this world: what lies on faces, and what falls before the camera at a tick.

use ds_space::{Digest, Draws, Tick, Vec2, Vec3};
use ds_world::{Condition, RoadSurface, Weather};

use crate::cells::{around, bumps};
use crate::material::{Paint, Stuff};

/// What lies and falls in a drive.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ground {
    surface: RoadSurface,
    weather: Weather,
    /// 0 to 1.
    amount: f32,
    key: Digest,
    seed: u32,
}

impl Ground {
    #[expect(clippy::cast_possible_truncation, reason = "shares in single precision")]
    pub(crate) fn new(condition: Condition, draws: &Draws, key: Digest, seed: u32) -> Self {
        let amount = draws.range(20, 0.55, 0.95) as f32;
        Self { surface: condition.surface(), weather: condition.weather(), amount, key, seed }
    }

    /// Says whether roads are wet.
    pub(crate) fn wet(&self) -> bool {
        self.surface == RoadSurface::Puddles
    }

    /// Returns an albedo under what lies there; `up` is the upward share of the normal.
    pub(crate) fn covered(&self, albedo: Vec3, paint: &Paint, p: Vec2, up: f32) -> Vec3 {
        let lying = |share: f32, over: Vec3| albedo + (over - albedo) * share.clamp(0.0, 0.97);
        let heap = bumps(p / 4.0, self.seed ^ 91);
        match self.surface {
            RoadSurface::SnowCovered => {
                let white = Vec3::new(0.86, 0.88, 0.92) * (0.88 + 0.16 * heap);
                let share = match paint.stuff {
                    Stuff::Slabs => 0.95 * self.amount + 1.1 * (heap - 0.5),
                    Stuff::Marking => 0.5 * self.amount + 0.9 * (heap - 0.5),
                    Stuff::Pane | Stuff::Glow => 0.0,
                    _ if paint.stuff.is_ground() => 0.75 + 0.3 * self.amount,
                    Stuff::Lacquer => 0.6 * self.amount * (up - 0.6).max(0.0) * 2.0,
                    _ => (up - 0.15).max(0.0) * 1.4,
                };
                lying(share, white)
            }
            RoadSurface::SandCovered => {
                // Long tongues of sand across the road.
                let tongue = bumps(Vec2::new(p.x / 11.0 + p.y / 30.0, p.y / 2.6), self.seed ^ 92);
                let sand = Vec3::new(0.55, 0.40, 0.20) * (0.85 + 0.3 * around(p / 0.5, self.seed ^ 93).tone);
                let share = match paint.stuff {
                    Stuff::Slabs => 1.6 * (tongue - 0.42) + 0.5 * self.amount,
                    Stuff::Marking => 1.2 * (tongue - 0.5) + 0.25 * self.amount,
                    Stuff::Pane | Stuff::Glow => 0.05,
                    _ if paint.stuff.is_ground() => 0.9,
                    _ => 0.2 + 0.3 * up.max(0.0),
                };
                lying(share, sand)
            }
            RoadSurface::Dry if self.weather == Weather::Snow && !paint.stuff.is_road() => {
                lying(0.3 * up.max(0.0), Vec3::splat(0.85))
            }
            RoadSurface::Puddles if paint.stuff.is_ground() => albedo * 0.5,
            RoadSurface::Dry | RoadSurface::Puddles => albedo,
        }
    }

    /// Returns how much of a place of the road is standing water.
    pub(crate) fn water(&self, paint: &Paint, p: Vec2) -> f32 {
        if !self.wet() || !paint.stuff.is_road() {
            return 0.0;
        }
        let basin = around(Vec2::new(p.x / 5.5, p.y / 3.0), self.seed ^ 94);
        ((0.20 + 0.34 * self.amount - basin.nearest) * 7.0).clamp(0.0, 1.0)
    }

    /// Draws what falls at a tick over the light of a picture.
    pub(crate) fn fall(&self, tick: Tick, picture: &mut Picture<'_>) {
        let draws = Draws::new(&self.key, "abroad-fall", &[u64::from(tick.0)]);
        let (wide, high) = (picture.width as f64, picture.height as f64);
        let view = wide * high / (picture.focal_px * picture.focal_px);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded")]
        let count = |per_view: f64| (per_view * view * f64::from(self.amount)).clamp(0.0, 4_000.0) as u64;
        match self.weather {
            Weather::Snow => {
                for i in 0..count(430.0) {
                    let u = |k: u64| draws.uniform(5 * i + k);
                    // Nearer flakes are larger and fewer.
                    let near = u(2).powi(3);
                    let radius = picture.focal_px * (0.0016 + 0.011 * near);
                    picture.blot(u(0) * wide, u(1) * high, radius * (1.0 + 0.6 * u(3)), radius, 0.75);
                }
            }
            Weather::Rain => {
                let lean = draws_lean(&self.key);
                for i in 0..count(210.0) {
                    let u = |k: u64| draws.uniform(5 * i + k);
                    let long = picture.focal_px * (0.05 + 0.16 * u(2).powi(2));
                    let (x, y) = (u(0) * wide, u(1) * 1.1 * high);
                    for step in 0..6u8 {
                        let along = f64::from(step) / 6.0;
                        picture.blot(x + lean * long * along, y - long * along, 0.45, long / 10.0, 0.22);
                    }
                }
            }
            Weather::Clear | Weather::Overcast | Weather::Fog => {}
        }
    }
}

fn draws_lean(key: &Digest) -> f64 {
    Draws::new(key, "abroad-wind", &[]).range(0, -0.35, 0.35)
}

/// The light of a picture while something falls over it.
pub(crate) struct Picture<'a> {
    pub(crate) light: &'a mut [Vec3],
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) focal_px: f64,
    /// Light of what falls.
    pub(crate) bright: Vec3,
}

impl Picture<'_> {
    /// Mixes an ellipse of half axes in pixels into the picture.
    fn blot(&mut self, x: f64, y: f64, across: f64, down: f64, strength: f64) {
        #[expect(clippy::cast_possible_truncation, reason = "float casts saturate")]
        let span = |at: f64, reach: f64| (at - reach - 1.0).floor() as i64..=(at + reach + 1.0).ceil() as i64;
        for row in span(y, down) {
            for column in span(x, across) {
                let (Ok(i), Ok(j)) = (usize::try_from(column), usize::try_from(row)) else { continue };
                if i >= self.width || j >= self.height {
                    continue;
                }
                let (dx, dy) = ((column as f64 + 0.5 - x).abs(), (row as f64 + 0.5 - y).abs());
                let share = (across + 0.5 - dx).clamp(0.0, 1.0) * (down + 0.5 - dy).clamp(0.0, 1.0) * strength;
                #[expect(clippy::cast_possible_truncation, reason = "light is reckoned in single precision")]
                let share = share as f32;
                let pixel = &mut self.light[j * self.width + i];
                *pixel += (self.bright - *pixel) * share;
            }
        }
    }
}
