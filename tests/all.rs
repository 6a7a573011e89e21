//! Everything that crosses a process border, in one program: what it links, half of the workspace, is linked once.

mod benchmark;
mod cameras;
mod closed_loop;
mod conditioning;
mod damage;
mod determinism;
mod faults;
mod fleet;
mod gap;
mod harness;
mod hostile;
mod metrics;
mod outsider;
mod own_policy;
mod python_policy;
mod scores;
mod secured;
mod service_run;
mod simulators;
mod video_model;
mod wall_clock;
mod watch;
