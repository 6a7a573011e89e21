//! Inference and training on the processor: the transformer and the tiny autoencoder as loops over plain buffers.
//!
//! Weights are packed once into panels; products are computed by an 8-row kernel over `pulp`'s vectors with bias,
//! activation, gate and residual fused in; attention never leaves its score tile; a 3×3 convolution is a product whose
//! rows overlap in the image. Work is cut into blocks by shape alone and every row is computed in one order, so that
//! results have the same bits for any number of threads. Parity with the framework's
//! graph is held by the tests of `ds_video`.

mod arch;
mod attention;
mod autoencoder;
mod blend;
mod block;
mod buffer;
mod cache;
mod clip;
mod convolution;
mod growth;
mod guide;
mod image;
mod lanes;
mod network;
mod norm;
mod panels;
pub mod peak;
mod product;
mod rotary;
#[cfg(test)]
mod tests;
pub mod train;
mod transformer;

pub use autoencoder::FastAe;
pub use clip::FastTeacher;
pub use transformer::FastDit;

pub(crate) use buffer::Buffer;
