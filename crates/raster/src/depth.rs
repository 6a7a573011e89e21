//! A z-buffered scanline rasteriser for triangles, bit-reproducible on one instruction set.
