//! What a pixel shows before light falls on it: material, colour, facing and class.

pub(crate) use ds_raster::PixelClass;
use ds_space::DVec3;

/// Red, green and blue in sRGB.
pub(crate) type Rgb = [u8; 3];

/// How a surface meets light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Material {
    Sky,
    Verge,
    Sidewalk,
    Kerb,
    Asphalt,
    Paint,
    Matte,
    Gloss,
    Glass,
    Lamp,
    Facade,
    Foliage,
}

impl Material {
    /// Says whether the surface is part of the ground plane.
    pub(crate) fn is_ground(self) -> bool {
        matches!(self, Self::Verge | Self::Sidewalk | Self::Kerb | Self::Asphalt | Self::Paint)
    }
}

/// What a pixel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Surface {
    pub(crate) material: Material,
    pub(crate) class: PixelClass,
    pub(crate) colour: Rgb,
    /// Outward unit normal in the world, times 127.
    pub(crate) normal: [i8; 3],
}

impl Surface {
    pub(crate) const SKY: Self =
        Self { material: Material::Sky, class: PixelClass::Sky, colour: [0; 3], normal: [0, 0, 127] };

    /// A part of the ground plane.
    pub(crate) const fn ground(material: Material, class: PixelClass, colour: Rgb) -> Self {
        Self { material, class, colour, normal: [0, 0, 127] }
    }

    /// A face of a solid; its normal is set when the face is built.
    pub(crate) const fn solid(material: Material, class: PixelClass, colour: Rgb) -> Self {
        Self { material, class, colour, normal: [0, 0, 127] }
    }

    pub(crate) fn facing(self, normal: DVec3) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "components of a unit vector times 127 fit")]
        let normal = (normal * 127.0).round().to_array().map(|n| n as i8);
        Self { normal, ..self }
    }
}
