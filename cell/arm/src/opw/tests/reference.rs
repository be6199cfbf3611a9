//! Two arms, and the same arms in the crate `rs-opw-kinematics`. The robot node's tests of configurations use them, too.

use arm::OpwParameters;
use rs_opw_kinematics::kinematics_impl::OPWKinematics;
use rs_opw_kinematics::parameters::opw_kinematics::Parameters;

/// The arm of Setup B.
pub(crate) const IRB_1100: OpwParameters = OpwParameters {
    a1: 0.0,
    a2: -10.0,
    b: 0.0,
    c1: 327.0,
    c2: 225.0,
    c3: 250.0,
    c4: 64.0,
    offsets: [0.0, 0.0, -90.0, 0.0, 0.0, 0.0],
    signs: [1; 6],
};

/// An arm in which no parameter is 0, so that a wrong term cannot cancel out.
pub(crate) const ODD: OpwParameters = OpwParameters {
    a1: 25.0,
    a2: 35.0,
    b: 40.0,
    c1: 400.0,
    c2: 455.0,
    c3: 420.0,
    c4: 80.0,
    offsets: [10.0, -90.0, 30.0, 0.0, 5.0, 180.0],
    signs: [-1, 1, 1, -1, 1, -1],
};

/// Returns the same arm in the crate `rs-opw-kinematics`, which takes radians.
pub(crate) fn reference(parameters: OpwParameters) -> OPWKinematics {
    let OpwParameters { a1, a2, b, c1, c2, c3, c4, offsets, signs } = parameters;
    let offsets = offsets.map(f64::to_radians);
    OPWKinematics::new(Parameters { a1, a2, b, c1, c2, c3, c4, offsets, sign_corrections: signs, dof: 6 })
}
