//! How the viewer's window is divided: the world beside the cameras, curves and events below.
//!
//! The world is shown in the frame of the ego from behind and above, so that it stays in sight. The library has no call
//! for the eye of a view; it is therefore written into the arrangement's own store before that is made active.

use ds_topic::SceneMessage;
use rerun::blueprint::components::PanelState;
use rerun::blueprint::{
    Blueprint, BlueprintActivation, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel, Spatial2DView,
    Spatial3DView, TextDocumentView, TextLogView, TimePanel, TimeSeriesView, Vertical,
};
use rerun::external::re_sdk_types::blueprint::archetypes::EyeControls3D;
use rerun::log::LogMsg;
use rerun::{RecordingStream, RecordingStreamBuilder, StoreId};

use crate::ViewError;
use crate::diagnosis::{ROOT, probabilities};
use crate::stream::{APPLICATION, TIMELINE};

/// The most cameras that get views of their own.
const MAX_CAMERAS: usize = 3;
/// Where the eye stands and looks, in the rig frame, in metres.
const EYE_IN_RIG: [f32; 3] = [-16.0, 0.0, 11.0];
const TARGET_IN_RIG: [f32; 3] = [10.0, 0.0, 0.0];

/// Sends the arrangement for an episode; where effects are named there are views of a running diagnosis as well.
pub(crate) fn send(scene: &SceneMessage, stream: &RecordingStream, effects: &[String]) -> Result<(), ViewError> {
    let world: ContainerLike = Spatial3DView::new("world").with_origin("world/ego").with_contents(["/world/**"]).into();
    let eye_path = match &world {
        ContainerLike::View(view) => Some(format!("{}/EyeControls3D", view.blueprint_path())),
        _ => None,
    };
    let (buffer, storage) = RecordingStreamBuilder::new(APPLICATION).memory()?;
    blueprint(scene, world, effects).send(&buffer, BlueprintActivation { make_active: true, make_default: true })?;
    let messages = storage.take();
    let store = messages.iter().map(LogMsg::store_id).find(|id| id.is_blueprint()).cloned();
    for message in messages.into_iter().filter(|message| Some(message.store_id()) == store.as_ref()) {
        if let (LogMsg::BlueprintActivationCommand(_), Some(store), Some(path)) = (&message, &store, &eye_path) {
            eye(store, path)?.into_iter().for_each(|message| stream.record_msg(message));
        }
        stream.record_msg(message);
    }
    Ok(())
}

/// Returns the messages that place the eye.
fn eye(store: &StoreId, path: &str) -> Result<Vec<LogMsg>, ViewError> {
    let (buffer, storage) = RecordingStreamBuilder::from_store_id(store).memory()?;
    buffer.set_time_sequence("blueprint", 0);
    let eye = EyeControls3D::new().with_position(EYE_IN_RIG).with_look_target(TARGET_IN_RIG);
    buffer.log(path, &eye)?;
    let messages = storage.take();
    Ok(messages.into_iter().filter(|message| matches!(message, LogMsg::ArrowMsg(id, _) if id == store)).collect())
}

fn blueprint(scene: &SceneMessage, world: ContainerLike, effects: &[String]) -> Blueprint {
    let mut columns: Vec<ContainerLike> = Vec::new();
    for camera in scene.scene.cameras.iter().take(MAX_CAMERAS) {
        let view = |kind: &str| -> ContainerLike {
            let origin = format!("camera/{}/{kind}", camera.id);
            Spatial2DView::new(format!("{kind} {}", camera.id)).with_origin(origin).into()
        };
        columns.push(Vertical::new([view("frame"), view("layout")]).into());
    }
    let mut curves: Vec<ContainerLike> = vec![
        TimeSeriesView::new("score").with_origin("score").into(),
        TimeSeriesView::new("speed").with_origin("curves").into(),
        TextLogView::new("events").with_origin("event").into(),
    ];
    if !effects.is_empty() {
        let likely = TimeSeriesView::new("which effect").with_origin("/").with_contents(probabilities(effects));
        let told = TextLogView::new("diagnosis").with_origin(format!("{ROOT}/verdict"));
        let place = TextDocumentView::new("where").with_origin(format!("{ROOT}/where"));
        curves.extend([likely.into(), Vertical::new([told.into(), place.into()]).into()]);
    }
    let upper = Horizontal::new([world, Horizontal::new(columns).into()]).with_column_shares([3.0, 2.0]);
    let root = Vertical::new([upper.into(), Horizontal::new(curves).into()]).with_row_shares([3.0, 1.0]);
    Blueprint::new(root)
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(TimePanel::new().with_state(PanelState::Collapsed).with_timeline(TIMELINE))
}
