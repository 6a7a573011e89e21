//! Latitude and longitude → metres on the plane that touches the WGS 84 ellipsoid at the first fix.

/// Major half axis, m, and squared eccentricity of the ellipsoid.
const ELLIPSOID: (f64, f64) = (6_378_137.0, 6.694_379_990_14e-3);

/// A plane that touches the ellipsoid at the first finite fix that it is shown.
#[derive(Debug, Clone, Copy, Default)]
pub struct Plane(Option<[f64; 2]>);

impl Plane {
    /// Returns how far a fix lies east and north of the first one, m; latitude and longitude in degrees. What is not finite
    /// gives what is not.
    #[must_use]
    pub fn place(&mut self, [latitude, longitude]: [f64; 2]) -> [f64; 2] {
        let here = [latitude.to_radians(), longitude.to_radians()];
        let first = match self.0 {
            None if here.iter().all(|a| a.is_finite()) => *self.0.insert(here),
            known => known.unwrap_or(here),
        };
        let narrowing = 1.0 - ELLIPSOID.1 * first[0].sin().powi(2);
        let turns = ((here[1] - first[1]) / std::f64::consts::TAU).round();
        let (up, along) = (here[0] - first[0], here[1] - first[1] - turns * std::f64::consts::TAU);
        [
            ELLIPSOID.0 / narrowing.sqrt() * first[0].cos() * along,
            ELLIPSOID.0 * (1.0 - ELLIPSOID.1) / narrowing.powf(1.5) * up,
        ]
    }
}
