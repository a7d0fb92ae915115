//! Does a USB carry more cameras than it can?

use std::collections::BTreeMap;

use super::super::facts::{Device, Facts, Usb};
use super::super::finding::{Finding, or_ok};

/// What is faster carries several cameras.
const SLOW_MBIT_S: u32 = 480;

/// Warns of cameras that share a slow bus.
pub fn check(facts: &Facts) -> Vec<Finding> {
    let mut by_bus: BTreeMap<u32, Vec<&str>> = BTreeMap::new();
    for device in &facts.devices {
        if let Device::There(Some(Usb { bus, speed_mbit_s })) = device.found
            && speed_mbit_s <= SLOW_MBIT_S
        {
            by_bus.entry(bus).or_default().push(&device.camera);
        }
    }
    let shared = by_bus.iter().filter(|(_, cameras)| cameras.len() > 1);
    let wrong = shared.map(|(bus, cameras)| {
        Finding::warn(
            format!("cameras {} share USB bus {bus}, which carries 480 Mbit/s", cameras.join(", ")),
            "plug each into a port of another controller (lsusb -t), or film MJPEG at a lower rate",
        )
    });
    or_ok(wrong.collect(), || Finding::ok("no two cameras of this machine share a slow bus"))
}
