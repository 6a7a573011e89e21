//! The frames of a case as they are shown to somebody who looks at them: real, and simulated in three states.
//!
//! One clip after the other, so that a case of many takes no more memory than one of a few.

use ds_diagnosis::schema::Diagnosis;
use ds_effect::picture::Picture;

use crate::case::{Frame, FrameCase};
use crate::error::FramesError;
use crate::evaluate::corrections;
use crate::how_far::{Correction, rendered, states};
use crate::streams::Streams;

/// Frames of one pair of streams, in the order of their numbers.
pub struct Shown {
    /// The pair's name.
    pub scene: String,
    /// The pair, all its frames included.
    pub case: FrameCase,
    /// The real frames that were asked for.
    pub real: Vec<Picture>,
    /// The same states simulated: as they are, with the ordinary mismatch, with the effects as well.
    pub simulated: [Vec<Picture>; 3],
    /// What effect-free frames would be, where streams agree pixel by pixel.
    pub twin: Option<Vec<Picture>>,
}

impl Streams {
    /// Shows the frames kept from the fit, or those whose numbers are wanted, with the corrections of a diagnosis.
    ///
    /// # Errors
    /// If pictures cannot be read, or whoever looks at them refuses.
    pub fn show<E: From<FramesError>>(
        &self,
        diagnosis: &Diagnosis,
        wanted: Option<&dyn Fn(u64) -> bool>,
        look: &mut dyn FnMut(Shown) -> Result<(), E>,
    ) -> Result<(), E> {
        let (correction, floors) = corrections(diagnosis);
        match self {
            Self::Pair(case) => look(shown(case.clone(), case.name.clone(), &correction, floors.is_none(), wanted)),
            Self::Clips(case) => case.clips.iter().try_for_each(|clip| {
                let scene = clip.folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
                look(shown(clip.first()?, scene, &correction, false, wanted))
            }),
        }
    }
}

fn shown(
    case: FrameCase,
    scene: String,
    correction: &Correction,
    aligned: bool,
    wanted: Option<&dyn Fn(u64) -> bool>,
) -> Shown {
    let wants = |n: u64| wanted.map_or_else(|| case.held.iter().any(|f| f.number == n), |wanted| wanted(n));
    let (real, simulated, twin) = if aligned {
        let (_, [real, sim, shifted, after, twin]) = states(&case, correction, &wants);
        (real, [sim, shifted, after], Some(twin))
    } else {
        let frames: Vec<&Frame> = case.fit.iter().chain(&case.held).filter(|f| wants(f.number)).collect();
        let set = |of: &dyn Fn(&Frame) -> &Picture| frames.iter().map(|f| of(f).clone()).collect::<Vec<_>>();
        let (real, sim) = (set(&|f| &f.real), set(&|f| &f.sim));
        (real, [sim.clone(), sim, rendered(&case, correction, &frames)], None)
    };
    Shown { scene, case, real, simulated, twin }
}
