//! May this user film with this machine's cameras?

use super::super::facts::{Device, DeviceFacts, Facts};
use super::super::finding::{Finding, or_ok};

/// Fails for devices that are not there or may not be opened.
pub fn check(facts: &Facts) -> Vec<Finding> {
    let wrong = facts.devices.iter().filter_map(of_device).collect();
    or_ok(wrong, || match facts.devices.len() {
        0 => Finding::ok("no camera of this machine is a device"),
        count => Finding::ok(format!("{count} devices may be opened")),
    })
}

fn of_device(device: &DeviceFacts) -> Option<Finding> {
    let DeviceFacts { camera, path, found } = device;
    match found {
        Device::There(_) => None,
        Device::Missing => Some(Finding::fail(
            format!("camera {camera}: {path} is not there"),
            "plug the camera in; v4l2-ctl --list-devices tells which device it is now",
        )),
        Device::Denied => Some(Finding::fail(
            format!("camera {camera}: this user may not open {path}"),
            "usermod -aG video USER, and log in again; SupplementaryGroups=video in a unit",
        )),
    }
}
