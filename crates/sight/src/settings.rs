//! Every threshold and scale of the diagnosis of frames in one place, each with its reason.
//!
//! Set on the practice cases and on draws of `tests/worlds/camera_world.py` other than those that are reported.

/// Degrees of freedom of the Student-t loss of displacements.
pub const NU: f64 = 4.0;
/// Gauss-Newton rounds of a geometry fit.
pub const GEOMETRY_ROUNDS: usize = 6;
/// Share of blocks that count as independent.
pub const BLOCK_SHARE: f64 = 0.3;
/// Error of a block's displacement that does not average out within it, px: resampling at this size.
pub const BLOCK_ERROR_PX: f64 = 0.06;
/// Side of the blocks, px.
pub const BLOCK_PX: usize = 16;
/// Frames looked at in full size.
pub const FULL_FRAMES: usize = 5;
/// Factor between the full and the small size.
pub const SMALL: usize = 4;
/// Spread of the constant image offset of every case, px: uniform within 0.25 (practice README).
pub const CONSTANT_SHIFT_PX: f64 = 0.15;
/// Spread of the image offset per frame, px: uniform within 0.25.
pub const FRAME_SHIFT_PX: f64 = 0.15;
/// Largest image offset that counts as nuisance, px.
pub const MOST_SHIFT_PX: f64 = 0.55;
/// Largest gain that counts as nuisance: 1 % in linear light plus three times 0.3 %.
pub const MOST_GAIN: f64 = 0.02;
/// Rows and columns of tiles.
pub const TILES: [usize; 2] = [4, 6];
/// Share of gradient energy that resampling leaves in the residual: full, small, coarse and colour band.
pub const TEXTURE: [f64; 4] = [0.012, 0.004, 0.0008, 0.0008];
/// Residual energy of flat places in the same bands, levels², beyond white noise.
pub const FLAT: [f64; 4] = [0.6, 0.25, 0.25, 0.5];
/// Variance of white noise at which the nuisance of every case ends, levels².
pub const MOST_NOISE: f64 = 1.6 * 1.6;
/// Variance of white noise of the quietest case, levels².
pub const LEAST_NOISE: f64 = 0.8 * 0.8;
/// Frames that count: losses are means over frames times this, so that long cases are not judged harder.
pub const COUNTED_FRAMES: f64 = 10.0;
/// ln of residual variance that an older frame must gain to be taken for the content.
pub const AGE_GAIN: f64 = 0.35;
