//! Longitude and latitude (WGS 84, degrees) ↔ easting and northing of a UTM zone (metres).
//!
//! Krüger's series to the sixth power of the third flattening, with the coefficients of Karney, "Transverse Mercator
//! with an accuracy of a few nanometers" (2011), equations 35 and 36: well below a millimetre in a zone and beside it.

use ds_space::DVec2;

/// Semi-major axis in metres and flattening of WGS 84.
const AXIS_M: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// Scale on the central meridian.
const SCALE: f64 = 0.9996;
const FALSE_EASTING_M: f64 = 500_000.0;
const FALSE_NORTHING_M: f64 = 10_000_000.0;
/// Third flattening.
const N: f64 = FLATTENING / (2.0 - FLATTENING);

/// A zone of UTM.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Zone {
    meridian_deg: f64,
    north: bool,
    code: u32,
}

/// Adds up a polynomial of [`N`], its lowest power first.
fn series(power: i32, terms: &[f64]) -> f64 {
    terms.iter().rev().fold(0.0, |sum, term| sum * N + term) * N.powi(power)
}

/// Radius of the rectifying sphere times the scale, in metres.
fn radius_m() -> f64 {
    SCALE * AXIS_M / (1.0 + N) * series(0, &[1.0, 0.0, 1.0 / 4.0, 0.0, 1.0 / 64.0, 0.0, 1.0 / 256.0])
}

/// From the conformal sphere to the plane.
fn alpha() -> [f64; 6] {
    [
        series(1, &[1.0 / 2.0, -2.0 / 3.0, 5.0 / 16.0, 41.0 / 180.0, -127.0 / 288.0, 7_891.0 / 37_800.0]),
        series(2, &[13.0 / 48.0, -3.0 / 5.0, 557.0 / 1_440.0, 281.0 / 630.0, -1_983_433.0 / 1_935_360.0]),
        series(3, &[61.0 / 240.0, -103.0 / 140.0, 15_061.0 / 26_880.0, 167_603.0 / 181_440.0]),
        series(4, &[49_561.0 / 161_280.0, -179.0 / 168.0, 6_601_661.0 / 7_257_600.0]),
        series(5, &[34_729.0 / 80_640.0, -3_418_889.0 / 1_995_840.0]),
        series(6, &[212_378_941.0 / 319_334_400.0]),
    ]
}

/// From the plane to the conformal sphere.
fn beta() -> [f64; 6] {
    [
        series(1, &[1.0 / 2.0, -2.0 / 3.0, 37.0 / 96.0, -1.0 / 360.0, -81.0 / 512.0, 96_199.0 / 604_800.0]),
        series(2, &[1.0 / 48.0, 1.0 / 15.0, -437.0 / 1_440.0, 46.0 / 105.0, -1_118_711.0 / 3_870_720.0]),
        series(3, &[17.0 / 480.0, -37.0 / 840.0, -209.0 / 4_480.0, 5_569.0 / 90_720.0]),
        series(4, &[4_397.0 / 161_280.0, -11.0 / 504.0, -830_251.0 / 7_257_600.0]),
        series(5, &[4_583.0 / 161_280.0, -108_847.0 / 3_991_680.0]),
        series(6, &[20_648_693.0 / 638_668_800.0]),
    ]
}

/// Returns Σ k_j·sin(2jξ)·cosh(2jη) and Σ k_j·cos(2jξ)·sinh(2jη).
fn waves(terms: &[f64; 6], xi: f64, eta: f64) -> (f64, f64) {
    let mut sums = (0.0, 0.0);
    for (j, term) in (1..).zip(terms) {
        let (turn, stretch) = (2.0 * f64::from(j) * xi, 2.0 * f64::from(j) * eta);
        sums.0 += term * turn.sin() * stretch.cosh();
        sums.1 += term * turn.cos() * stretch.sinh();
    }
    sums
}

fn eccentricity() -> f64 {
    (FLATTENING * (2.0 - FLATTENING)).sqrt()
}

/// Returns the tangent of the conformal latitude.
fn conformal(tan: f64) -> f64 {
    let e = eccentricity();
    let secant = 1.0f64.hypot(tan);
    let sigma = (e * (e * tan / secant).atanh()).sinh();
    tan * 1.0f64.hypot(sigma) - sigma * secant
}

impl Zone {
    /// Returns the zone of an EPSG code: 32601 to 32660 north, 32701 to 32760 south of the equator.
    pub(super) fn of(code: u32) -> Option<Self> {
        let (number, north) = match code {
            32_601..=32_660 => (code - 32_600, true),
            32_701..=32_760 => (code - 32_700, false),
            _ => return None,
        };
        Some(Self { meridian_deg: 6.0 * f64::from(number) - 183.0, north, code })
    }

    /// Returns the EPSG code.
    pub(super) fn code(self) -> u32 {
        self.code
    }

    fn false_northing_m(self) -> f64 {
        if self.north { 0.0 } else { FALSE_NORTHING_M }
    }

    /// Returns easting and northing of a longitude and latitude; `None` for what is none, or lies far off the zone.
    pub(super) fn plane(self, degrees: DVec2) -> Option<DVec2> {
        let east_deg = degrees.x - self.meridian_deg;
        if !(degrees.is_finite() && east_deg.abs() <= 30.0 && degrees.y.abs() <= 85.0) {
            return None;
        }
        let (sine, cosine) = east_deg.to_radians().sin_cos();
        let tan = conformal(degrees.y.to_radians().tan());
        let (xi, eta) = (tan.atan2(cosine), (sine / tan.hypot(cosine)).asinh());
        let (along, across) = waves(&alpha(), xi, eta);
        Some(DVec2::new(
            FALSE_EASTING_M + radius_m() * (eta + across),
            self.false_northing_m() + radius_m() * (xi + along),
        ))
    }

    /// Returns longitude and latitude of an easting and northing.
    pub(super) fn degrees(self, plane: DVec2) -> DVec2 {
        let xi = (plane.y - self.false_northing_m()) / radius_m();
        let eta = (plane.x - FALSE_EASTING_M) / radius_m();
        let (along, across) = waves(&beta(), xi, eta);
        let (xi, eta) = (xi - along, eta - across);
        let (sine, cosine) = xi.sin_cos();
        let wanted = sine / eta.sinh().hypot(cosine);
        // Newton's method: the conformal latitude is close to the latitude.
        let e2 = eccentricity() * eccentricity();
        let mut tan = wanted / (1.0 - e2);
        for _ in 0..5 {
            let found = conformal(tan);
            let slope = (1.0 - e2) * 1.0f64.hypot(found) * 1.0f64.hypot(tan) / (1.0 + (1.0 - e2) * tan * tan);
            tan += (wanted - found) / slope;
        }
        DVec2::new(self.meridian_deg + eta.sinh().atan2(cosine).to_degrees(), tan.atan().to_degrees())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// EPSG code, longitude, latitude, easting, northing as PROJ 9 gives them (pyproj 3, six decimals).
    const REFERENCE: [(u32, [f64; 2], [f64; 2]); 12] = [
        (32_611, [-115.1728, 36.1147], [664_450.975_062, 3_998_216.335_324]),
        (32_611, [-117.0, 0.0], [500_000.0, 0.0]),
        (32_611, [-119.9, 41.3], [257_201.234_870, 4_576_118.064_409]),
        (32_611, [-114.0, 49.99], [715_028.859_904, 5_541_832.437_643]),
        (32_619, [-71.0589, 42.3601], [330_448.106_479, 4_691_812.059_469]),
        (32_619, [-66.1, 79.5], [558_974.642_625, 8_827_246.862_762]),
        (32_617, [-79.945, 40.4087], [589_516.113_062, 4_473_654.796_590]),
        (32_648, [103.7869, 1.299], [365_036.659_938, 143_611.170_449]),
        (32_648, [105.0, 0.1], [500_000.0, 11_053.004_724]),
        (32_756, [151.2093, -33.8688], [334_368.633_648, 6_250_948.345_385]),
        (32_633, [15.0, 45.0], [500_000.0, 4_982_950.400_227]),
        (32_633, [18.5, 60.2], [693_981.282_023, 6_678_828.823_312]),
    ];

    #[test]
    fn places_of_the_zones_are_those_of_proj_and_back() {
        for (code, degrees, plane) in REFERENCE {
            let zone = Zone::of(code).expect("a zone");
            let found = zone.plane(DVec2::from_array(degrees)).expect("it lies in the zone");
            assert!((found - DVec2::from_array(plane)).length() < 1e-5, "{code} {degrees:?}: {found}");
            let back = zone.degrees(found);
            assert!((back - DVec2::from_array(degrees)).length() < 1e-11, "{code} {degrees:?}: {back}");
        }
    }

    #[test]
    fn what_is_no_zone_or_no_place_is_none() {
        for code in [0, 4_326, 32_600, 32_661, 32_700, 32_761] {
            assert_eq!(Zone::of(code), None, "{code}");
        }
        let zone = Zone::of(32_619).expect("a zone");
        for degrees in [[f64::NAN, 42.0], [-71.0, 91.0], [104.0, 1.3], [-71.0, f64::INFINITY]] {
            assert_eq!(zone.plane(DVec2::from_array(degrees)), None, "{degrees:?}");
        }
    }
}
