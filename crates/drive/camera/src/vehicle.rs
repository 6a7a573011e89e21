//! Motor vehicles: lower body, cabin with windows, wheels, lights; cars, vans, trucks and buses by their size.

use ds_space::{DVec3, Draws};
use ds_world::AgentState;

use crate::solid::{Builder, Facet, Skin, Slab};
use crate::surface::{Material, PixelClass, Rgb, Surface};

const PAINTS: [Rgb; 12] = [
    [236, 236, 234],
    [226, 226, 228],
    [176, 180, 184],
    [118, 122, 128],
    [52, 54, 58],
    [30, 31, 34],
    [160, 26, 28],
    [32, 62, 128],
    [60, 108, 168],
    [34, 82, 58],
    [206, 190, 150],
    [196, 132, 34],
];

/// What a vehicle's lamps show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Lamps {
    /// Head and tail lights are on.
    pub(crate) on: bool,
    /// The vehicle brakes.
    pub(crate) braking: bool,
}

/// The surfaces of one vehicle.
struct Livery {
    body: Surface,
    trim: Surface,
    glass: Surface,
    head: Surface,
    tail: Surface,
}

const fn part(material: Material, colour: Rgb) -> Surface {
    Surface::solid(material, PixelClass::Vehicle, colour)
}

/// Adds a vehicle; `paint` gives its colour.
pub(crate) fn add(agent: &AgentState, paint: &Draws, lamps: Lamps, facets: &mut Vec<Facet>) {
    #[expect(clippy::cast_possible_truncation, reason = "below the number of paints")]
    let colour = PAINTS[paint.below(0, PAINTS.len() as u64) as usize];
    let livery = Livery {
        body: part(Material::Gloss, colour),
        trim: part(Material::Matte, [22, 22, 24]),
        glass: part(Material::Glass, [36, 44, 52]),
        head: part(if lamps.on { Material::Lamp } else { Material::Gloss }, [250, 246, 226]),
        tail: match lamps {
            Lamps { braking: true, .. } => part(Material::Lamp, [255, 40, 24]),
            Lamps { on: true, .. } => part(Material::Lamp, [170, 20, 16]),
            _ => part(Material::Gloss, [150, 16, 18]),
        },
    };
    let size = agent.size;
    let mut builder = Builder::new(agent.pose, agent.z_m, facets);
    let (l, w, h) = (size.length_m, size.width_m, size.height_m);
    if h >= 2.5 || l >= 6.8 {
        if paint.uniform(1) < 0.35 {
            bus(&mut builder, &livery, [l, w, h])
        } else {
            truck(&mut builder, &livery, [l, w, h])
        }
    } else {
        car(&mut builder, &livery, [l, w, h]);
    }
    running_gear(&mut builder, &livery, [l, w, h]);
}

fn car(builder: &mut Builder, livery: &Livery, [l, w, h]: [f64; 3]) {
    let (f, r) = (0.5 * l, -0.5 * l);
    let boxy = h > 1.75;
    let belt = if boxy { 0.58 * h } else { 0.6 * h };
    let sill = 0.17 * h;
    let side = 0.5 * w;
    let body = Skin::all(livery.body);
    builder.frustum(Slab::new(sill, r, f, side), Slab::new(0.42 * h, r, f, side), &body);
    builder.frustum(Slab::new(0.42 * h, r, f, side), Slab::new(belt, r + 0.02 * l, f - 0.05 * l, 0.94 * side), &body);
    let (rear_foot, front_foot) = if boxy { (r + 0.02 * l, f - 0.2 * l) } else { (r + 0.1 * l, f - 0.26 * l) };
    let (rear_roof, front_roof) = if boxy { (r + 0.07 * l, f - 0.34 * l) } else { (r + 0.23 * l, f - 0.43 * l) };
    let glass = Skin { top: livery.body, ..Skin::all(livery.glass) };
    builder.frustum(
        Slab::new(belt, rear_foot, front_foot, 0.9 * side),
        Slab::new(0.96 * h, rear_roof, front_roof, 0.76 * side),
        &glass,
    );
    builder.frustum(
        Slab::new(0.955 * h, rear_roof - 0.01 * l, front_roof + 0.01 * l, 0.78 * side),
        Slab::new(h, rear_roof + 0.02 * l, front_roof - 0.03 * l, 0.7 * side),
        &body,
    );
    let pillar = 0.5 * (rear_roof + front_roof);
    builder.frustum(
        Slab::new(belt, pillar - 0.05, pillar + 0.05, 0.905 * side),
        Slab::new(0.96 * h, pillar - 0.05, pillar + 0.05, 0.765 * side),
        &body,
    );
}

fn truck(builder: &mut Builder, livery: &Livery, [l, w, h]: [f64; 3]) {
    let (f, r, side) = (0.5 * l, -0.5 * l, 0.5 * w);
    let cab = f - (0.28 * l).min(2.2);
    let load = part(Material::Matte, [214, 214, 208]);
    builder.block(Slab::new(0.28 * h, r, cab - 0.15, side), 0.72 * h, load);
    let top = 0.86 * h;
    builder.frustum(
        Slab::new(0.16 * h, cab, f, 0.97 * side),
        Slab::new(top, cab, f - 0.12, 0.94 * side),
        &Skin::all(livery.body),
    );
    let window = Skin { top: livery.body, ..Skin::all(livery.glass) };
    builder.frustum(
        Slab::new(0.52 * h, cab + 0.35, f - 0.035, 0.975 * side),
        Slab::new(0.76 * h, cab + 0.35, f - 0.06, 0.965 * side),
        &window,
    );
    builder.plate_x(DVec3::new(r - 0.02, 0.0, 0.62 * h), 0.02, 0.34 * h, livery.trim);
}

fn bus(builder: &mut Builder, livery: &Livery, [l, w, h]: [f64; 3]) {
    let (f, r, side) = (0.5 * l, -0.5 * l, 0.5 * w);
    builder.frustum(Slab::new(0.1 * h, r, f, side), Slab::new(h, r, f - 0.1, 0.97 * side), &Skin::all(livery.body));
    let band = Skin { top: livery.body, ..Skin::all(livery.glass) };
    builder.frustum(
        Slab::new(0.42 * h, r - 0.02, f + 0.01, side + 0.01),
        Slab::new(0.78 * h, r - 0.02, f - 0.04, side + 0.005),
        &band,
    );
}

/// Wheels, underbody, bumpers, lamps and number plates.
fn running_gear(builder: &mut Builder, livery: &Livery, [l, w, h]: [f64; 3]) {
    let (f, r, side) = (0.5 * l, -0.5 * l, 0.5 * w);
    builder.block(Slab::new(0.06, r + 0.08 * l, f - 0.06 * l, 0.88 * side), 0.22 * h.min(2.0), livery.trim);
    let radius = (0.22 * h).clamp(0.26, 0.5);
    let tyre = part(Material::Matte, [18, 18, 19]);
    let hub = part(Material::Matte, [120, 122, 126]);
    for x in [r + 0.19 * l, f - 0.18 * l] {
        for y in [side, -side] {
            builder.disc_y(DVec3::new(x, y * 1.01, radius), radius, tyre);
            builder.disc_y(DVec3::new(x, y * 1.02, radius), 0.55 * radius, hub);
            builder.block(Slab::new(0.0, x - 0.8 * radius, x + 0.8 * radius, 0.1).moved_left(0.86 * y), radius, tyre);
        }
    }
    let lamp_z = if h < 2.5 { 0.46 * h } else { 0.24 * h };
    for y in [0.74 * side, -0.74 * side] {
        builder.plate_x(DVec3::new(r - 0.03, y, lamp_z + 0.02 * h), 0.2 * side, 0.075 * h.min(2.0), livery.tail);
        builder.plate_x(DVec3::new(f + 0.03, y, lamp_z), 0.19 * side, 0.05 * h.min(2.0), livery.head);
    }
    for x in [r - 0.02, f + 0.02] {
        builder.plate_x(DVec3::new(x, 0.0, 0.21 * h.min(2.0)), 0.92 * side, 0.05 * h.min(2.0), livery.trim);
        builder.plate_x(
            DVec3::new(1.004 * x, 0.0, 0.3 * h.min(2.0)),
            0.27,
            0.07,
            part(Material::Matte, [225, 225, 220]),
        );
    }
}
