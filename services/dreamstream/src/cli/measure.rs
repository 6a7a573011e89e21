//! Arguments of `measure`.

use std::path::PathBuf;

use clap::{Args, ValueHint};

use ds_launch::choice::backend;
use ds_process::shipped;
use ds_video::Backend;

const EXAMPLES: &str = "Examples:
  dreamstream measure --model configs/models/wan2.1-fun-1.3b-control.toml --backend cuda --peak-tflops 790
  dreamstream measure --model configs/models/wan2.2-5b.toml --backend vulkan
  dreamstream measure --model configs/models/wan-tiny.toml         on any processor, in a minute

The weights are drawn, so that none need to be there; figures are of time and memory alone. Graphics processors need a
build with --features cuda or --features vulkan, see docs/wan.md.";

/// Arguments of `measure`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct MeasureArgs {
    /// Configuration of a published video model.
    #[arg(long, default_value = "configs/models/wan-tiny.toml", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub model: PathBuf,
    /// What computes.
    #[arg(long, default_value = "framework", value_parser = backend(&Backend::ALL[1..]))]
    pub backend: Backend,
    /// Chunks that are measured after one that is not; the median counts.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub rounds: u32,
    /// What the device can do at most by its maker, in 10^12 operations a second, to state shares of that as well.
    #[arg(long, value_name = "TFLOPS")]
    pub peak_tflops: Option<f64>,
    /// Side of the square matrices whose product is the yardstick; 0 chooses by device.
    #[arg(long, default_value_t = 0)]
    pub yardstick: usize,
}
