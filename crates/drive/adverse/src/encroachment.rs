//! How narrowly the expert and the adversary miss each other in time: post-encroachment time (Allen, Shin and Cooper 1978).

use ds_sim::Simulation;
use ds_space::plane::OrientedBox;

use crate::stage::pair;

/// Ego and adversary of each tick of a drive.
#[derive(Debug, Default)]
pub(crate) struct Passing {
    ego: Vec<OrientedBox>,
    adversary: Vec<OrientedBox>,
}

impl Passing {
    /// Remembers where both are now; nothing without an adversary.
    pub(crate) fn see(&mut self, simulation: &Simulation) {
        if let Some((ego, adversary)) = pair(simulation.scene(), simulation.state()) {
            self.ego.push(ego);
            self.adversary.push(adversary.footprint());
        }
    }

    /// Returns the least number of ticks between one of the two being at a place and the other; nothing if none comes where
    /// the other was.
    pub(crate) fn post_encroachment_ticks(&self) -> Option<u32> {
        let meets = |ahead: &[OrientedBox], behind: &[OrientedBox], apart: usize| {
            ahead.iter().zip(&behind[apart..]).any(|(first, second)| first.touches(second))
        };
        let either =
            |apart: &usize| meets(&self.ego, &self.adversary, *apart) || meets(&self.adversary, &self.ego, *apart);
        (0..self.ego.len()).find(either).map(|apart| apart as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::{DVec2, PoseSe2};

    /// A car of 4 by 2 m at each tick of a straight drive, metres a tick.
    fn drive(start: DVec2, step: DVec2) -> Vec<OrientedBox> {
        let at = |tick: u32| PoseSe2 { position: start + step * f64::from(tick), heading_rad: step.to_angle() };
        (0..30).map(|tick| OrientedBox::new(&at(tick), 4.0, 2.0)).collect()
    }

    #[test]
    fn it_is_the_time_between_two_at_one_place_whoever_comes_first() {
        let east = drive(DVec2::new(-10.0, 0.0), DVec2::X);
        // their middles cross at (0, 0), at ticks 10 and 25: bodies of 3 m from middle to middle share ground 9 ticks apart
        let north = drive(DVec2::new(0.0, -25.0), DVec2::Y);
        let aside = drive(DVec2::new(-10.0, 5.0), DVec2::X);
        for (ego, adversary, ticks) in
            [(&east, &north, Some(9)), (&north, &east, Some(9)), (&east, &aside, None), (&east, &east, Some(0))]
        {
            let passing = Passing { ego: ego.clone(), adversary: adversary.clone() };
            assert_eq!(passing.post_encroachment_ticks(), ticks);
        }
        assert_eq!(Passing::default().post_encroachment_ticks(), None);
    }
}
