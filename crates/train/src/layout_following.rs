//! How well generated frames follow their layouts (see the parts below).
