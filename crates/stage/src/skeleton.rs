//! The person's joints: from targets for pelvis, hands and feet to joint places of fixed bone lengths.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::maths::{across, turn_x, turn_y, turn_z};

/// Metres from pelvis to waist.
pub(crate) const LOWER_SPINE_M: f64 = 0.14;
/// Metres from waist to the base of the neck.
pub(crate) const UPPER_SPINE_M: f64 = 0.375;
/// Metres from the base of the neck to that of the skull.
pub(crate) const NECK_M: f64 = 0.09;
/// Metres from the base of the skull to the middle of the head.
pub(crate) const SKULL_M: f64 = 0.078;
/// Metres from shoulder to elbow.
pub(crate) const UPPER_ARM_M: f64 = 0.29;
/// Metres from elbow to wrist.
pub(crate) const FOREARM_M: f64 = 0.26;
/// Metres from wrist to the knuckles.
pub(crate) const PALM_M: f64 = 0.088;
/// Metres from hip to knee.
pub(crate) const THIGH_M: f64 = 0.43;
/// Metres from knee to ankle.
pub(crate) const SHIN_M: f64 = 0.40;
/// Shoulder and hip joints in the frames of chest (from the waist) and pelvis, left side.
const SHOULDER: [f64; 3] = [0.175, 0.314, -0.005];
const HIP: [f64; 3] = [0.088, -0.03, 0.0];

/// A joint, or the end of a limb, of the person. Left is the person's left: +X while it faces +Z.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "the names say it all")]
pub enum Joint {
    Pelvis,
    Waist,
    Neck,
    SkullBase,
    /// The middle of the head.
    Head,
    LeftShoulder,
    LeftElbow,
    LeftWrist,
    /// The knuckles, 8.8 cm from the wrist.
    LeftHand,
    LeftHip,
    LeftKnee,
    LeftAnkle,
    /// The ball of the foot.
    LeftToe,
    RightShoulder,
    RightElbow,
    RightWrist,
    /// The knuckles, 8.8 cm from the wrist.
    RightHand,
    RightHip,
    RightKnee,
    RightAnkle,
    /// The ball of the foot.
    RightToe,
}

/// Where one arm should be, in the root frame (on the floor below the person, +Z to its front).
#[derive(Clone, Copy, Debug)]
pub(crate) struct ArmTarget {
    pub wrist: Vector3<f64>,
    /// Where the elbow points.
    pub elbow_hint: Vector3<f64>,
    /// Where the hand points; zero goes on along the forearm.
    pub hand: Vector3<f64>,
    /// Where the palm faces.
    pub palm: Vector3<f64>,
    /// 0 for an open hand, 1 for a fist.
    pub curl: f64,
}

/// Where one foot should be, in the root frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LegTarget {
    pub ankle: Vector3<f64>,
    /// Turn of the foot about +Y.
    pub yaw_rad: f64,
    /// Toes down, heel up.
    pub pitch_rad: f64,
}

/// All that a motion decides; the skeleton follows. Sides: 0 left, 1 right.
#[derive(Clone, Debug)]
pub(crate) struct Targets {
    pub root_world: Vector3<f64>,
    pub heading_rad: f64,
    pub pelvis: Vector3<f64>,
    pub pelvis_yaw_rad: f64,
    pub lean_rad: f64,
    pub twist_rad: f64,
    pub bend_rad: f64,
    pub nod_rad: f64,
    pub look_rad: f64,
    pub arms: [ArmTarget; 2],
    pub legs: [LegTarget; 2],
}

/// +1 for the left side, −1 for the right.
pub(crate) fn side_sign(side: usize) -> f64 {
    if side == 0 { 1.0 } else { -1.0 }
}

impl Targets {
    /// Standing at the origin, arms at the sides.
    pub fn neutral() -> Targets {
        let arm = |side: usize| ArmTarget {
            wrist: Vector3::new(0.232 * side_sign(side), 0.873, 0.035),
            elbow_hint: Vector3::new(0.35 * side_sign(side), 0.0, -1.0),
            hand: Vector3::zeros(),
            palm: Vector3::new(-side_sign(side), 0.0, -0.25),
            curl: 0.25,
        };
        let leg = |side: usize| LegTarget {
            ankle: Vector3::new(0.105 * side_sign(side), 0.088, -0.01),
            yaw_rad: 0.16 * side_sign(side),
            pitch_rad: 0.0,
        };
        Targets {
            root_world: Vector3::zeros(),
            heading_rad: 0.0,
            pelvis: Vector3::new(0.0, 0.944, 0.0),
            pelvis_yaw_rad: 0.0,
            lean_rad: 0.02,
            twist_rad: 0.0,
            bend_rad: 0.0,
            nod_rad: 0.0,
            look_rad: 0.0,
            arms: [arm(0), arm(1)],
            legs: [leg(0), leg(1)],
        }
    }
}

/// One arm in the world.
#[derive(Clone, Debug)]
pub(crate) struct Arm {
    pub shoulder: Vector3<f64>,
    pub elbow: Vector3<f64>,
    pub wrist: Vector3<f64>,
    pub knuckles: Vector3<f64>,
    /// Unit, from wrist to knuckles; and where the palm faces, across it.
    pub hand: Vector3<f64>,
    pub palm: Vector3<f64>,
    pub curl: f64,
}

/// One leg in the world.
#[derive(Clone, Debug)]
pub(crate) struct Leg {
    pub hip: Vector3<f64>,
    pub knee: Vector3<f64>,
    pub ankle: Vector3<f64>,
    pub foot: Matrix3<f64>,
}

/// The posed person in the world. Columns of a frame: its left, up and front.
#[derive(Clone, Debug)]
pub(crate) struct Skeleton {
    pub pelvis: Vector3<f64>,
    pub waist: Vector3<f64>,
    pub neck: Vector3<f64>,
    pub skull_base: Vector3<f64>,
    pub head: Vector3<f64>,
    pub pelvis_frame: Matrix3<f64>,
    pub chest_frame: Matrix3<f64>,
    pub head_frame: Matrix3<f64>,
    pub arms: [Arm; 2],
    pub legs: [Leg; 2],
}

/// The ball of the foot from the ankle, in the foot's frame.
pub(crate) const TOE_FOOT: [f64; 3] = [0.0, -0.055, 0.125];

impl Skeleton {
    pub fn from_targets(targets: &Targets) -> Skeleton {
        let root = turn_y(targets.heading_rad);
        let world = |v: &Vector3<f64>| root * v + targets.root_world;
        let pelvis = world(&targets.pelvis);
        let bend = |share: f64| {
            turn_y(targets.twist_rad * share)
                * turn_x(targets.lean_rad * share)
                * turn_z(targets.bend_rad * share)
        };
        let pelvis_frame = root * turn_y(targets.pelvis_yaw_rad) * turn_x(0.35 * targets.lean_rad);
        let chest_frame = root * bend(1.0);
        let waist = pelvis + root * bend(0.5) * Vector3::new(0.0, LOWER_SPINE_M, 0.0);
        let neck = waist + chest_frame * Vector3::new(0.0, UPPER_SPINE_M, 0.0);
        // The head keeps half upright while the chest leans.
        let neck_frame = root * turn_x(0.75 * targets.lean_rad) * turn_z(targets.bend_rad);
        let skull_base = neck + neck_frame * Vector3::new(0.0, NECK_M, 0.012);
        let head_frame = root * turn_y(targets.look_rad) * turn_x(0.45 * targets.lean_rad + targets.nod_rad);
        let head = skull_base + head_frame * Vector3::new(0.0, SKULL_M, 0.012);
        let arms = [0, 1].map(|side| {
            let [x, y, z] = SHOULDER;
            let shoulder = waist + chest_frame * Vector3::new(x * side_sign(side), y, z);
            arm(&targets.arms[side], shoulder, &root, world(&targets.arms[side].wrist))
        });
        let legs = [0, 1].map(|side| {
            let [x, y, z] = HIP;
            let hip = pelvis + pelvis_frame * Vector3::new(x * side_sign(side), y, z);
            let target = &targets.legs[side];
            let foot = root * turn_y(target.yaw_rad) * turn_x(target.pitch_rad);
            let hint = root * turn_y(target.yaw_rad) * Vector3::z();
            let (knee, ankle) = two_bones(&hip, &world(&target.ankle), THIGH_M, SHIN_M, &hint);
            Leg { hip, knee, ankle, foot }
        });
        Skeleton { pelvis, waist, neck, skull_base, head, pelvis_frame, chest_frame, head_frame, arms, legs }
    }

    /// A joint's place in the world, metres.
    pub fn joint(&self, joint: Joint) -> Point3<f64> {
        let ([left_arm, right_arm], [left_leg, right_leg]) = (&self.arms, &self.legs);
        let toe = |leg: &Leg| leg.ankle + leg.foot * Vector3::from(TOE_FOOT);
        Point3::from(match joint {
            Joint::Pelvis => self.pelvis,
            Joint::Waist => self.waist,
            Joint::Neck => self.neck,
            Joint::SkullBase => self.skull_base,
            Joint::Head => self.head,
            Joint::LeftShoulder => left_arm.shoulder,
            Joint::LeftElbow => left_arm.elbow,
            Joint::LeftWrist => left_arm.wrist,
            Joint::LeftHand => left_arm.knuckles,
            Joint::LeftHip => left_leg.hip,
            Joint::LeftKnee => left_leg.knee,
            Joint::LeftAnkle => left_leg.ankle,
            Joint::LeftToe => toe(left_leg),
            Joint::RightShoulder => right_arm.shoulder,
            Joint::RightElbow => right_arm.elbow,
            Joint::RightWrist => right_arm.wrist,
            Joint::RightHand => right_arm.knuckles,
            Joint::RightHip => right_leg.hip,
            Joint::RightKnee => right_leg.knee,
            Joint::RightAnkle => right_leg.ankle,
            Joint::RightToe => toe(right_leg),
        })
    }
}

fn arm(target: &ArmTarget, shoulder: Vector3<f64>, root: &Matrix3<f64>, wrist: Vector3<f64>) -> Arm {
    let hint = root * target.elbow_hint;
    let (elbow, wrist) = two_bones(&shoulder, &wrist, UPPER_ARM_M, FOREARM_M, &hint);
    let along = (wrist - elbow).normalize();
    // `hand` is a wish of some strength beside the forearm's own direction, so that it can fade in.
    let hand = (along * (1.0 - target.hand.norm()).max(0.0) + root * target.hand).normalize();
    let palm = across(&hand, &(root * target.palm));
    Arm { shoulder, elbow, wrist, knuckles: wrist + hand * PALM_M, hand, palm, curl: target.curl }
}

/// Two bones from `root` towards `target`, bent towards `hint`: the middle joint and the end, which is
/// the target where it is in reach.
fn two_bones(
    root: &Vector3<f64>,
    target: &Vector3<f64>,
    first_m: f64,
    second_m: f64,
    hint: &Vector3<f64>,
) -> (Vector3<f64>, Vector3<f64>) {
    let offset = target - root;
    let axis = if offset.norm() > 1e-9 { offset.normalize() } else { -Vector3::y() };
    let reach = offset.norm().clamp((first_m - second_m).abs() + 0.05, 0.9995 * (first_m + second_m));
    let along = (first_m * first_m - second_m * second_m + reach * reach) / (2.0 * reach);
    let aside = (first_m * first_m - along * along).max(0.0).sqrt();
    let middle = root + axis * along + across(&axis, hint) * aside;
    (middle, root + axis * reach)
}
