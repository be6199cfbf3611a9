//! Checks of the bus: what the standard of each allows.

use std::time::Duration;

use ethernet_ip::connection::TimeoutMultiplier;
use profinet::rt::{COUNT_NANOS, Transport};
use protocol::stations::{ETHERNET_IP_ROBOT, PROFINET_ROBOT, is_station_name};

use super::{Check, cycle, problem};
use crate::{
    Addresses, Bus, BusKind, Cyclic, Ethercat, EthernetIp, EthernetIpFormat, Profinet, ProfinetDevice,
    device_file,
};

/// Cycles that a MainDevice on Linux can keep.
const ETHERCAT_CYCLES_US: std::ops::RangeInclusive<u32> = 250..=100_000;
/// Register 0x0420 of a SubDevice: 65535 steps of 100 µs.
const ETHERCAT_LONGEST_WATCHDOG: Duration = Duration::from_micros(6_553_500);
/// Process data each way that fit one frame together with those of the other direction.
const ETHERCAT_MAX_BYTES: u16 = 700;

/// Configuration data in bytes that a Forward_Open carries.
const MOST_CONFIGURATION: usize = 400;

pub(super) fn check(bus: &Bus) -> Check {
    cycle("bus.cycle_us", &bus.cycle_us)?;
    if bus.watchdog_cycles.value == 0 {
        return Err(problem(
            "bus.watchdog_cycles",
            "0 would give every connection up at once; at least 1, and 3 is usual",
        ));
    }
    if bus.clock_drift_ppm.value > 1_000 {
        let text = format!(
            "{} ppm: must be at most 1000, which even a poor quartz keeps",
            bus.clock_drift_ppm.value
        );
        return Err(problem("bus.clock_drift_ppm", text));
    }
    if bus.cable_delay_us.value > 100_000 {
        return Err(problem("bus.cable_delay_us", "must be at most 100 ms"));
    }
    check_peers(bus)?;
    device_file::check(bus)?;
    match &bus.kind {
        BusKind::Profinet(addresses, profinet) => {
            check_addresses(addresses)?;
            check_profinet(bus, profinet)
        }
        BusKind::EthernetIp(addresses, ethernet_ip) => {
            check_addresses(addresses)?;
            check_ethernet_ip(bus, ethernet_ip)
        }
        BusKind::Ethercat(ethercat) => check_ethercat(bus, ethercat),
    }
}

/// Checks that each peer is listed by something that its bus tells: any other peer would not be checked at all.
fn check_peers(bus: &Bus) -> Check {
    let listed = bus.allowed_plcs.iter().map(|peer| ("bus.allowed_plcs", peer));
    for (key, peer) in listed.chain(bus.robot.iter().map(|peer| ("bus.robot", peer))) {
        let (mac, serial_number) = (peer.mac.is_some(), peer.serial_number.is_some());
        let text = match bus.kind {
            _ if peer.address.is_none() && !mac && !serial_number => {
                "an entry without address, mac and serial_number lists nobody"
            }
            BusKind::Profinet(..) if serial_number => {
                "a PROFINET station tells no serial number: list its mac"
            }
            BusKind::EthernetIp(..) if mac => {
                "EtherNet/IP does not tell a MAC address: list the serial_number"
            }
            BusKind::Ethercat(_) => "EtherCAT has no stations to list: whoever is on the cable is obeyed",
            _ if key == "bus.robot" && peer.address.is_some() => {
                "the robot's address is bus.robot_address: leave it out here"
            }
            _ => continue,
        };
        return Err(problem(key, text));
    }
    Ok(())
}

fn check_ethercat(bus: &Bus, ethercat: &Ethercat) -> Check {
    let cycle_us = bus.cycle_us.value;
    if !(ETHERCAT_CYCLES_US.contains(&cycle_us)) {
        let (shortest, longest) = ETHERCAT_CYCLES_US.into_inner();
        let text = format!("{cycle_us} µs is not a cycle of this MainDevice: {shortest} to {longest} µs");
        return Err(problem("bus.cycle_us", text));
    }
    let hold = bus.watchdog();
    if hold > ETHERCAT_LONGEST_WATCHDOG {
        let most = ETHERCAT_LONGEST_WATCHDOG.as_micros() / u128::from(cycle_us);
        let text = format!(
            "{} cycles of {cycle_us} µs hold for {} ms; the watchdog of a SubDevice has {} ms at most, so at most {most} cycles",
            bus.watchdog_cycles.value,
            hold.as_millis(),
            ETHERCAT_LONGEST_WATCHDOG.as_millis(),
        );
        return Err(problem("bus.watchdog_cycles", text));
    }
    let Some(device) = &ethercat.device else { return Ok(()) };
    for (key, bytes) in [("output_bytes", device.output_bytes), ("input_bytes", device.input_bytes)] {
        if !(1..=ETHERCAT_MAX_BYTES).contains(&bytes) {
            let text = format!(
                "{bytes} bytes cannot carry the process image in one frame: 1 to {ETHERCAT_MAX_BYTES} bytes"
            );
            return Err(problem(format!("bus.ethercat.device.{key}"), text));
        }
    }
    Ok(())
}

fn check_addresses(&Addresses { plc, robot, mask }: &Addresses) -> Check {
    if plc == robot {
        return Err(problem("bus.robot_address", format!("{robot} is the PLC's address as well")));
    }
    let bits = u32::from(mask);
    if bits.leading_ones() + bits.trailing_zeros() != 32 {
        return Err(problem("bus.subnet_mask", format!("{mask} is not a subnet mask")));
    }
    if u32::from(plc) & bits != u32::from(robot) & bits {
        let text = format!("{robot} is not in the subnet of {plc}");
        return Err(problem("bus.robot_address", text));
    }
    Ok(())
}

fn check_ethernet_ip(bus: &Bus, ethernet_ip: &EthernetIp) -> Check {
    let (shortest, longest) = (ETHERNET_IP_ROBOT.min_rpi_us, ETHERNET_IP_ROBOT.max_rpi_us);
    let adapter = ethernet_ip.adapter.as_ref();
    // If a foreign adapter does not support the interval, it refuses the connection.
    if adapter.is_none() && !(shortest..=longest).contains(&bus.cycle_us.value) {
        let text = format!(
            "{} µs is not a packet interval that the robot serves: {shortest} to {longest} µs",
            bus.cycle_us.value
        );
        return Err(problem("bus.cycle_us", text));
    }
    let intervals = ethernet_ip.timeout_intervals(&bus.watchdog_cycles);
    let covering = TimeoutMultiplier::at_least(intervals).map(TimeoutMultiplier::intervals);
    if ethernet_ip.timeout_multiplier.is_some() && covering != Some(intervals) {
        let text =
            format!("{intervals} is not a multiplier of EtherNet/IP: 4, 8, 16, 32, 64, 128, 256 or 512");
        return Err(problem("bus.ethernet_ip.timeout_multiplier", text));
    }
    let formats = adapter.map(|adapter| {
        [
            ("consumed", adapter.consumed_format, adapter.consumed_bytes),
            ("produced", adapter.produced_format, adapter.produced_bytes),
        ]
    });
    for (direction, format, bytes) in formats.into_iter().flatten() {
        if format == EthernetIpFormat::Heartbeat && bytes > 0 {
            let text =
                format!("a heartbeat carries none of {direction}_bytes = {bytes}: give 0, or another format");
            return Err(problem(format!("bus.ethernet_ip.adapter.{direction}_format"), text));
        }
    }
    if adapter.is_some_and(|adapter| adapter.route.len() % 2 != 0) {
        let text = "a padded path has an even number of bytes";
        return Err(problem("bus.ethernet_ip.adapter.route", text));
    }
    let configuration = adapter.map_or(0, |adapter| adapter.configuration_data.len());
    if configuration > MOST_CONFIGURATION {
        let text = format!("{configuration} bytes: at most {MOST_CONFIGURATION} fit into a Forward_Open");
        return Err(problem("bus.ethernet_ip.adapter.configuration_data", text));
    }
    if covering.is_none() {
        let text =
            format!("an EtherNet/IP connection waits for 512 packet intervals at most, not for {intervals}");
        return Err(problem("bus.watchdog_cycles", text));
    }
    Ok(())
}

fn check_profinet(bus: &Bus, profinet: &Profinet) -> Check {
    let cycle_ns = u64::from(bus.cycle_us.value) * 1_000;
    let units = cycle_ns / COUNT_NANOS;
    if cycle_ns % COUNT_NANOS != 0 || !units.is_power_of_two() {
        let text = format!(
            "{} µs is not a PROFINET cycle: 31.25 µs times a power of two, such as 250, 500, 1000, 2000, 4000",
            bus.cycle_us.value
        );
        return Err(problem("bus.cycle_us", text));
    }
    let (class, transport) = match profinet.cyclic {
        Cyclic::Udp => ("udp", Transport::Udp),
        Cyclic::Rt1 => ("rt1", Transport::Rt1),
    };
    let most_units = u64::from(transport.max_counts());
    // A foreign device refuses a cycle that is too short for it.
    let least_units = if profinet.device.is_none() { PROFINET_ROBOT.min_device_interval.into() } else { 1 };
    if !(least_units..=most_units).contains(&units) {
        let micros = |units: u64| units * COUNT_NANOS / 1_000;
        let text = format!(
            "{} µs is not a cycle that can be served over {class}: {} to {} µs",
            bus.cycle_us.value,
            micros(least_units),
            micros(most_units),
        );
        return Err(problem("bus.cycle_us", text));
    }
    let most = transport.max_hold_factor(Duration::from_nanos(cycle_ns));
    if bus.watchdog_cycles.value > most.into() {
        let text = format!(
            "{} cycles of {} µs hold for {} ms; PROFINET allows {} ms over {class}, so at most {most} cycles",
            bus.watchdog_cycles.value,
            bus.cycle_us.value,
            bus.watchdog().as_millis(),
            transport.max_hold_time().as_millis(),
        );
        return Err(problem("bus.watchdog_cycles", text));
    }
    station_name("bus.profinet.plc_station_name", &profinet.plc_station_name)?;
    station_name("bus.profinet.robot_station_name", &profinet.robot_station_name)?;
    if profinet.plc_station_name == profinet.robot_station_name {
        return Err(problem("bus.profinet.robot_station_name", "the PLC has the same name"));
    }
    profinet.device.as_ref().map_or(Ok(()), profinet_device)
}

/// Checks that the description lists each slot and subslot once and in order, as a controller needs for its Connect.
fn profinet_device(device: &ProfinetDevice) -> Check {
    let key = "bus.profinet.device.modules";
    if !device.modules.is_sorted_by(|one, next| one.slot < next.slot) {
        return Err(problem(key, "list every slot once, the lowest first"));
    }
    for (index, module) in device.modules.iter().enumerate() {
        if module.submodules.is_empty()
            || !module.submodules.is_sorted_by(|one, next| one.subslot < next.subslot)
        {
            let text = "list every subslot once, the lowest first; a module has at least one";
            return Err(problem(format!("{key}[{index}].submodules"), text));
        }
    }
    let submodules = || device.modules.iter().flat_map(|module| &module.submodules);
    let inputs: u64 = submodules().map(|submodule| u64::from(submodule.input_bytes)).sum();
    let outputs: u64 = submodules().map(|submodule| u64::from(submodule.output_bytes)).sum();
    if inputs == 0 || outputs == 0 {
        let text = format!(
            "the modules have {inputs} bytes of input and {outputs} of output; the process image needs both"
        );
        return Err(problem(key, text));
    }
    Ok(())
}

/// Checks a name of station by IEC 61158-6-10: labels of letters, digits and hyphens, at most 63 characters each,
/// separated by dots.
fn station_name(key: &str, name: &str) -> Check {
    if !name.is_empty() && is_station_name(name.as_bytes()) {
        return Ok(());
    }
    let text = format!(
        "`{name}` is not a name of station: lower-case letters, digits and hyphens, in labels of 1 to 63 \
         characters with dots between them, 240 in all, and neither an IP address nor port-001"
    );
    Err(problem(key, text))
}
