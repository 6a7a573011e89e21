// Coloured world triangles through a pinhole. Positions are relative to the picture's anchor, in metres; depth is
// reversed and infinite: near plane 1, far 0. The same two entry points serve ground (painted in order, no depth) and
// boxes (depth-tested).

struct Pinhole {
    clip_from_local: mat4x4<f32>,
}

@group(0) @binding(0) var<uniform> pinhole: Pinhole;

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) colour: vec4<f32>,
}

@vertex
fn place(@location(0) position: vec3<f32>, @location(1) colour: vec4<f32>) -> Corner {
    var corner: Corner;
    corner.position = pinhole.clip_from_local * vec4<f32>(position, 1.0);
    corner.colour = colour;
    return corner;
}

@fragment
fn shade(corner: Corner) -> @location(0) vec4<f32> {
    return corner.colour;
}
