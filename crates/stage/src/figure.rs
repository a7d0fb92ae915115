//! The person's flesh, hair and clothes on its joints.

use nalgebra::{Matrix3, Vector3};

use crate::skeleton::{Arm, Leg, Skeleton, TOE_FOOT, side_sign};
use crate::solid::{Material, Solid};

/// All solids of the person.
pub(crate) fn solids(skeleton: &Skeleton, solids: &mut Vec<Solid>) {
    trunk(skeleton, solids);
    head(skeleton, solids);
    for side in [0, 1] {
        leg(&skeleton.legs[side], solids);
        arm(&skeleton.arms[side], side_sign(side), solids);
    }
}

fn trunk(skeleton: &Skeleton, solids: &mut Vec<Solid>) {
    let (pelvis, waist) = (&skeleton.pelvis_frame, skeleton.waist);
    let chest = &skeleton.chest_frame;
    let low = |x, y, z| skeleton.pelvis + pelvis * Vector3::new(x, y, z);
    let high = |x, y, z| waist + chest * Vector3::new(x, y, z);
    let (pelvis_left, left) = (pelvis.column(0).into_owned(), chest.column(0).into_owned());
    let trunk = |ends, radii, flat, material| Solid::limb(ends, radii, (left, flat), material);
    // The hips, and the seat behind them.
    solids.push(Solid::limb(
        (low(0.0, -0.055, -0.012), low(0.0, 0.065, 0.0)),
        (0.168, 0.146),
        (pelvis_left, 0.68),
        Material::Belted,
    ));
    for x in [0.075, -0.075] {
        solids.push(
            Solid::limb(
                (low(x, -0.06, -0.055), low(x, 0.0, -0.045)),
                (0.082, 0.07),
                (pelvis_left, 1.0),
                Material::Trousers,
            )
            .without_shadow(),
        );
    }
    // Belly, rib cage, and the bar of the shoulders with the slope up to the neck.
    solids.push(trunk((low(0.0, 0.085, 0.0), high(0.0, 0.06, 0.004)), (0.146, 0.143), 0.66, Material::Shirt));
    solids.push(trunk(
        (high(0.0, 0.03, 0.004), high(0.0, 0.235, 0.0)),
        (0.140, 0.166),
        0.66,
        Material::Shirt,
    ));
    solids.push(Solid::limb(
        (high(-0.125, 0.297, -0.012), high(0.125, 0.297, -0.012)),
        (0.072, 0.072),
        (chest.column(1).into_owned(), 1.08),
        Material::Yoke,
    ));
    for sign in [1.0, -1.0] {
        solids.push(
            Solid::limb(
                (high(0.035 * sign, 0.372, -0.012), high(0.155 * sign, 0.312, -0.01)),
                (0.050, 0.054),
                (left, 1.0),
                Material::Yoke,
            )
            .without_shadow(),
        );
    }
}

fn head(skeleton: &Skeleton, solids: &mut Vec<Solid>) {
    let (centre, frame) = (skeleton.head, &skeleton.head_frame);
    let at = |x, y, z| centre + frame * Vector3::new(x, y, z);
    let left = frame.column(0).into_owned();
    let neck = (skeleton.neck - skeleton.chest_frame.column(1) * 0.02, at(0.0, -0.045, -0.018));
    solids.push(Solid::limb(neck, (0.060, 0.052), (left, 1.0), Material::Skin));
    // Skull with the face on it, jaw, nose, ears.
    let half = Vector3::new(0.074, 0.108, 0.094);
    solids.push(Solid::ellipsoid(at(0.0, 0.005, 0.0), *frame, half, Material::Face));
    let jaw = (at(0.0, -0.035, 0.028), at(0.0, -0.083, 0.052));
    solids.push(Solid::limb(jaw, (0.060, 0.033), (left, 0.85), Material::Skin).without_shadow());
    let nose = (at(0.0, 0.005, 0.093), at(0.0, -0.026, 0.106));
    solids.push(Solid::limb(nose, (0.009, 0.015), (left, 1.0), Material::Skin).without_shadow());
    for sign in [1.0, -1.0] {
        let ear = at(0.075 * sign, -0.008, -0.008);
        let half = Vector3::new(0.012, 0.031, 0.019);
        solids.push(Solid::ellipsoid(ear, *frame, half, Material::Skin).without_shadow());
    }
    let half = Vector3::new(0.083, 0.098, 0.098);
    solids.push(Solid::ellipsoid(at(0.0, 0.034, -0.019), *frame, half, Material::Hair));
}

fn arm(arm: &Arm, sign: f64, solids: &mut Vec<Solid>) {
    let along = (arm.wrist - arm.elbow).normalize();
    let bend = (arm.elbow - arm.shoulder).cross(&(arm.wrist - arm.elbow));
    let side = if bend.norm_squared() > 1e-10 { bend } else { arm.palm };
    let sleeve_end = arm.shoulder.lerp(&arm.elbow, 0.72);
    solids.push(Solid::limb((arm.shoulder, sleeve_end), (0.059, 0.053), (side, 1.0), Material::Sleeve));
    solids.push(Solid::limb((arm.shoulder, arm.elbow), (0.052, 0.040), (side, 1.0), Material::Skin));
    // The forearm is thickest a third of the way down.
    let belly = arm.elbow + along * 0.075;
    solids
        .push(Solid::limb((arm.elbow, belly), (0.040, 0.044), (side, 1.0), Material::Skin).without_shadow());
    solids.push(Solid::limb((belly, arm.wrist), (0.044, 0.027), (side, 1.0), Material::Skin));
    hand(arm, sign, solids);
}

fn hand(arm: &Arm, sign: f64, solids: &mut Vec<Solid>) {
    let (hand, palm) = (arm.hand, arm.palm);
    // Towards the thumb: up, for a left hand that points ahead with its palm to the right.
    let thumb = palm.cross(&hand) * -sign;
    let at = |along: f64, aside: f64, down: f64| arm.wrist + hand * along + thumb * aside + palm * down;
    solids.push(Solid::limb(
        (at(0.018, 0.0, 0.0), at(0.062, 0.0, 0.0)),
        (0.034, 0.040),
        (thumb, 0.46),
        Material::Skin,
    ));
    let (s, c) = libm::sincos(1.75 * arm.curl);
    let (s2, c2) = libm::sincos(2.9 * arm.curl);
    for finger in 0..4 {
        let aside = 0.030 - 0.020 * f64::from(finger);
        let length_m = [0.040, 0.044, 0.042, 0.034][finger as usize];
        let spread = aside * 0.25 * (1.0 - arm.curl);
        let knuckle = at(0.080, aside, 0.0);
        let middle = knuckle + (hand * c + palm * s) * length_m + thumb * spread * 0.5;
        let tip = middle + (hand * c2 + palm * s2) * (0.82 * length_m) + thumb * spread * 0.5;
        for (ends, radii) in [((knuckle, middle), (0.0105, 0.0095)), ((middle, tip), (0.0095, 0.008))] {
            solids.push(Solid::limb(ends, radii, (thumb, 1.0), Material::Skin).without_shadow());
        }
    }
    let root = at(0.028, 0.026, 0.006);
    let joint = root + (hand * 0.7 + thumb * (0.75 - 0.5 * arm.curl) + palm * 0.35).normalize() * 0.040;
    let tip = joint
        + (hand * 0.9 + thumb * (0.35 - 0.9 * arm.curl) + palm * (0.2 + 0.3 * arm.curl)).normalize() * 0.034;
    for (ends, radii) in [((root, joint), (0.0145, 0.0115)), ((joint, tip), (0.0115, 0.009))] {
        solids.push(Solid::limb(ends, radii, (thumb, 1.0), Material::Skin).without_shadow());
    }
}

fn leg(leg: &Leg, solids: &mut Vec<Solid>) {
    let along = (leg.ankle - leg.knee).normalize();
    let left = leg.foot.column(0).into_owned();
    solids.push(Solid::limb((leg.hip, leg.knee), (0.084, 0.062), (left, 1.0), Material::Trousers));
    // The calf behind the shin, and the trousers' straight end.
    let calf = leg.knee + along * 0.12 - leg.foot.column(2) * 0.012;
    solids.push(
        Solid::limb((leg.knee, calf), (0.061, 0.062), (left, 1.0), Material::Trousers).without_shadow(),
    );
    solids.push(Solid::limb((calf, leg.ankle), (0.062, 0.047), (left, 1.0), Material::Trousers));
    let foot: &Matrix3<f64> = &leg.foot;
    let at = |x: f64, y: f64, z: f64| leg.ankle + foot * Vector3::new(x, y, z);
    let [x, y, z] = TOE_FOOT;
    let sole = |from, to, radii, flat| Solid::limb((from, to), radii, (left, flat), Material::Shoe);
    solids.push(sole(at(0.0, -0.044, -0.035), at(x, y, z), (0.044, 0.046), 0.72));
    // The toes stay flat on the floor while the heel lifts.
    let ahead = foot.column(2);
    let flat = Vector3::new(ahead.x, ahead.y.max(0.0), ahead.z).normalize();
    let tip = at(x, y, z) + flat * 0.04 - Vector3::new(0.0, 0.004, 0.0);
    solids.push(sole(at(x, y, z), tip, (0.046, 0.036), 0.70).without_shadow());
    solids.push(sole(at(0.0, -0.005, -0.012), at(0.0, -0.045, 0.075), (0.045, 0.038), 0.9).without_shadow());
}
