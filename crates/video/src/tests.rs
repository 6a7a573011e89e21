//! Equivalence tests.
