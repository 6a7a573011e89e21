//! Placeholder until this service is written.
