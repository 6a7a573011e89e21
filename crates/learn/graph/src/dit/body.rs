//! The transformer on the framework's graph behind the trait that all bodies share.

use ds_nn::array::Array;
use ds_nn::body::{Chunk, ChunkKv, Context, Control, FrameKv, Handle, Transformer, Window};
use ds_nn::dit::DitShape;

use super::window::GraphWindow;
use crate::dit::{self, Dit};

impl Transformer for Dit {
    fn shape(&self) -> &DitShape {
        &self.shape
    }

    fn forwards(&self) -> u64 {
        Self::forwards(self)
    }

    fn context(&self, text: &Array, first: &Array) -> Context {
        Context(Handle::new(Self::context(self, text, first)))
    }

    fn control(&self, layouts: &Array) -> Control {
        Control(Handle::new(Self::control(self, layouts)))
    }

    fn control_of(&self, latent: &Array) -> Control {
        Control(Handle::new(Self::control_of(self, latent)))
    }

    fn control_values(&self, control: &Control) -> Array {
        let values = control.0.of::<dit::Control>().values();
        // Without channels the graph holds a placeholder.
        if self.shape.control_channels > 0 { values } else { Array::zeros(&[1, values.shape()[1], 4, 0]) }
    }

    fn window(&self, frames: &[(&FrameKv, usize)], current: &[usize]) -> Window {
        Window(Handle::new(GraphWindow::read(self, frames, current)))
    }

    fn denoise(&self, chunk: &Chunk<'_>, window: &Window, context: &Context) -> (Array, ChunkKv) {
        let Chunk { noisy, start, control, time } = *chunk;
        Self::denoise(self, &dit::Chunk { noisy, start, control: control.0.of(), time }, window, context.0.of())
    }
}
