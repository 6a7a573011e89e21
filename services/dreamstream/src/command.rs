//! The commands, one file each.

pub(crate) mod bench;
pub(crate) mod certs;
pub(crate) mod doctor;
pub(crate) mod health;
pub(crate) mod measure;
pub(crate) mod policy;
pub(crate) mod recording;
pub(crate) mod replay;
pub(crate) mod report;
pub(crate) mod scenario;
pub(crate) mod score;
pub(crate) mod serve;
pub(crate) mod top;
pub(crate) mod view;
pub(crate) mod why;
