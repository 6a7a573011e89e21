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
pub const FULL_FRAMES: usize = 4;
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
pub const TEXTURE: [f64; 4] = [0.014, 0.0012, 0.00004, 0.0001];
/// Residual energy of flat places in the same bands, levels², beyond white noise.
pub const FLAT: [f64; 4] = [0.6, 0.1, 0.02, 0.06];
/// Variance of white noise at which the nuisance of every case ends, levels².
pub const MOST_NOISE: f64 = 1.6 * 1.6;
/// Variance of white noise of the quietest case, levels².
pub const LEAST_NOISE: f64 = 0.8 * 0.8;
/// Frames that count: losses are means over frames times this, so that long cases are not judged harder.
pub const COUNTED_FRAMES: f64 = 10.0;
/// ln of residual variance that an older frame must gain to be taken for the content.
pub const AGE_GAIN: f64 = 0.35;
/// Loss that a first effect must take away beyond its cost.
pub const FIRST_GAIN: f64 = 20.0;
/// Loss that a further effect must take away beyond its cost.
pub const FURTHER_GAIN: f64 = 40.0;
/// The same as a share of what the effects before it took away: a rough model of a strong effect leaves something.
pub const FURTHER_SHARE: f64 = 0.08;
/// The same for effects on fine detail, which show in a band of their own.
pub const FURTHER_FINE_SHARE: f64 = 0.02;
/// Loss per unit of ln residual variance of an age.
pub const AGE_WEIGHT: f64 = 20.0;
/// Variance of flat places that every case may have, noise of 1.6 levels and two encoders, levels².
pub const FLAT_NOISE: f64 = 4.5;
/// Variance of flat places of the usual case, levels².
pub const USUAL_NOISE: f64 = 2.0;
/// Price of a smooth field of free gain in every frame.
pub const FLICKER_COST: f64 = 60.0;
/// Spread of ln gain from frame to frame below which brightness does not flicker.
pub const LEAST_FLICKER: f64 = 0.012;
/// Price of the map of a dirty lens: once, and per share of the picture that it changes.
pub const DIRT_COST: [f64; 2] = [30.0, 300.0];
/// Largest share of the picture that dirt may change.
pub const MOST_DIRT: f64 = 0.5;
/// Log posterior of displacements that a geometry effect must gain to be tried.
pub const GEOMETRY_GAIN: f64 = 6.0;
/// Most effects in one diagnosis.
pub const MOST_EFFECTS: usize = 3;
/// Share of each covariance's off-diagonal that the feature distance removes.
pub const SHRINKAGE: f64 = 0.1;
/// Draws of the bootstrap of the feature distance.
pub const FEATURE_DRAWS: u64 = 20;
/// Draws of every other bootstrap.
pub const BOOTSTRAP_DRAWS: u64 = 300;
/// Excess over (twin + 1 level²) from which a tile counts (practice README).
pub const TILE_EXCESS: f64 = 0.25;
/// Excess over (twin + 1 level²) from which a frame counts (practice README).
pub const FRAME_EXCESS: f64 = 0.5;
/// Loss by band that effect-free cases stay below: fine, medium, coarse, colour (two of eight effect-free draws of
/// `tests/worlds/camera_world.py`, seed 8001, passed 110 in colour).
pub const CLEAN: [f64; 4] = [110.0, 130.0, 190.0, 190.0];
/// Share of the loss beyond that of clean cases that the chosen effects must explain.
pub const EXPLAINED_SHARE: f64 = 0.35;
/// The same where objects come or go, whose parts are not told from the background, or where depth, known roughly, decides.
pub const ROUGH_SHARE: f64 = 0.15;
/// Temperature of the probabilities: loss is no log likelihood.
pub const TEMPERATURE: f64 = 8.0;
/// Ratio to the clean level from which a band without any chosen effect is strange.
pub const CLEAN_RATIO: f64 = 1.8;
/// Variance of flat places (robust, worst brightness) from which noise of every case cannot account for it, levels².
pub const STRANGE_NOISE: f64 = 9.0;
/// Width of the passage from known to unknown, in log units.
pub const UNKNOWN_WIDTH: f64 = 0.15;
/// Loss difference below which two effects form a group.
pub const GROUP_GAIN: f64 = 12.0;
/// Cosine of signatures from which two effects form a group (specification, section 3.3).
pub const GROUP_COSINE: f64 = 0.95;
/// Draws of tiles for intervals of effects on fine detail.
pub const TILE_DRAWS: u64 = 100;
/// Gain below which an effect is not tried again on top of a model in place.
pub const HOPELESS_GAIN: f64 = -30.0;
/// Variance of flat places at white from which it is no noise of a usual case: clean cases keep 4, the practice moire 70.
pub const STRANGE_WHITE: f64 = 25.0;
/// An estimate within this many nuisance standard deviations is not a finding (specification, section 3.3).
pub const MARGIN_SDS: f64 = 2.5;
/// Share of the slab below which an effect of several parameters is not there.
pub const LEAST_EFFECT: f64 = 0.04;
/// Correlation of medium detail in all but a quarter of the blocks from which two streams agree pixel by pixel, and from which they show the same states.
pub const ALIGNED_AGREEMENT: f64 = 0.45;
/// See [`ALIGNED_AGREEMENT`].
pub const LAYOUT_AGREEMENT: f64 = 0.3;
/// Effect-free pairs that are needed to learn what a generator does.
pub const FEWEST_NUISANCE: usize = 5;
/// Seeds of the generator that a clip must have: their scatter is estimated.
pub const FEWEST_SEEDS: usize = 2;
/// Clips that a case must have: sign flips of fewer cannot reach 5 %.
pub const FEWEST_CLIPS: usize = 6;
/// Chance of clips without any effect from which none is said to act.
pub const MOST_CHANCE: f64 = 0.05;
/// Groups of effect-free clips that are judged to learn which gains come by chance.
pub const FREE_GROUPS: u64 = 24;
/// Effect-free clips for which correlations of their statistics count half.
pub const CLIP_SHRINKAGE: f64 = 15.0;
/// Size of a clip's deviation, over the middle one, from which it counts less.
pub const USUAL_CLIP: f64 = 1.3;
/// Spread over distances of a bias that is not known: tens of grey levels, ln contrast.
pub const BIAS_BY_DISTANCE: [f64; 2] = [0.3, 0.2];
/// Gain that an effect must have where the bias is not known, so that the spread is a guess.
pub const FREE_GAIN: f64 = 50.0;
/// Share of a gain that effects on clips must differ by to be told apart: what they do is known about so well.
pub const ROUGH_SIGNATURE: f64 = 0.1;
/// By how much a further effect on clips must exceed the gain that is needed.
pub const FURTHER_CLIP_GAIN: f64 = 3.0;
/// Effect-free clips on whose real frames effects are tried.
pub const SIGNATURE_CLIPS: usize = 8;
/// Clips for which the built-in spread counts where there are no effect-free ones.
pub const BUILT_IN_CLIPS: f64 = 4.0;
/// Frames of a clip looked at in full size.
pub const CLIP_FULL_FRAMES: usize = 8;
/// By how much a gain must exceed the best on effect-free pairs.
pub const NUISANCE_MARGIN: f64 = 1.1;
/// Gain that an effect on other than aligned streams must have at least.
pub const LEAST_PAIRING_GAIN: f64 = 14.0;
/// Squared distance, over that of effect-free pairs and one gain, from which what remains is strange.
pub const STRANGE_REMAINS: f64 = 2.0;
/// Displacement of one colour against another, at half the width, that no usual case has, px.
pub const STRANGE_FRINGE_PX: f64 = 0.5;
/// Share of what effects took away on other than aligned streams that may remain.
pub const STRANGE_SHARE: f64 = 0.25;
/// Standard deviation of the gain of one colour that the gain of the case and the encoder leave open.
pub const COLOUR_ERROR: f64 = 0.005;
/// Share of what effects before it took away that an effect on objects must gain: what moves by depth moves objects as
/// well.
pub const FURTHER_OBJECTS_SHARE: f64 = 0.15;
/// Share of what displacements before it took away that a further one must gain on other than aligned streams.
pub const FURTHER_MOVED_SHARE: f64 = 0.4;

/// Half width of an interval on other than aligned streams as a share of the effect: fine detail, depth and time are not
/// the generator's strength.
#[must_use]
pub fn pairing_shape(id: &str) -> f64 {
    match id {
        "jpeg_loss" | "sensor_noise" | "fog_haze" | "rain_streaks" => 0.5,
        "radial_distortion" | "mount_position" | "exposure_lag" | "dropped_frames" => 0.35,
        "rolling_shutter" => 1.0,
        _ => 0.15,
    }
}

/// The same on clips of a video model, whose edges tell less than half of a displacement.
#[must_use]
pub fn clip_shape(displaces: bool) -> f64 {
    if displaces { 1.2 } else { 0.4 }
}
