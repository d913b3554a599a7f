//! Where friction is known: only sliding surfaces have a direction.

use rivet_dynamics::{Structure, WristCoupling};

/// Whether everything that rubs in joint `j` slides: the joint itself, and the coupled motor, which turns with the sum of
/// two joints and can stand still while both move. A surface that sticks carries any torque up to breakaway: its row
/// would bias friction, and all the more so with instruments, whose planned motion does slide.
///
/// `speed` \[rad/s\] of a joint; `dead_zone` \[rad/s\], one value a joint.
pub(crate) fn slides(structure: &Structure, dead_zone: &[f64], speed: impl Fn(usize) -> f64, j: usize) -> bool {
    let coupled = match structure.coupling {
        Some(WristCoupling { driving, driven }) if j == driving || j == driven => {
            (speed(driving) + speed(driven)).abs() >= dead_zone[driven]
        }
        _ => true,
    };
    coupled && speed(j).abs() >= dead_zone[j]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coupled_motor_that_stands_still_silences_both_its_joints() {
        let structure = Structure { coupling: Some(WristCoupling { driving: 1, driven: 2 }), ..Structure::default() };
        let zone = [0.1; 3];
        let used = |speed: [f64; 3]| [0, 1, 2].map(|j| slides(&structure, &zone, |j| speed[j], j));
        assert_eq!(used([1.0, 0.5, 0.5]), [true, true, true]);
        assert_eq!(used([1.0, 0.5, -0.45]), [true, false, false]);
        assert_eq!(used([0.0, 0.5, 0.05]), [false, true, false]);
    }
}
