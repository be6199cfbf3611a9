//! Machines on real sockets, in network namespaces that the tests create and that disappear with them.
//!
//! No test asserts a time or a share of frames, because a shared host stalls.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod batches;
mod bridge;
mod destinations;
mod ethernet_ip;
mod former_address;
mod gateway;
mod interfaces;
mod machines;
mod neighbours;
mod recorder;
mod streams;
mod test_network;

use std::net::{Ipv4Addr, SocketAddrV4};
use std::ops::ControlFlow;
use std::process::ExitCode;

use machine::{Instant, PortRequest};
use machines::{Cable, Echo, Station};
use protocol::fieldbus::LinkEvent;
use protocol_linux::handover::Received;
use protocol_linux::{
    CyclicThread, Driver, DriverError, Interface, NoticeSender, Notifier, OpenPort, Statistics, Task, clock,
};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use test_network::{ADDRESSES, TIMEOUT, TestNetwork};

#[global_allocator]
static ALLOCATOR: protocol_linux::allocation::AllocationCounter =
    protocol_linux::allocation::AllocationCounter;

fn main() -> ExitCode {
    networked_tests::run(networked_tests::tests![
        two_stations_exchange_images_over_raw_ethernet,
        two_stations_exchange_images_in_priority_tagged_frames,
        two_stations_exchange_images_over_udp,
        frames_of_another_vlan_are_discarded,
        cyclic_requests_are_answered_each_once,
        a_driver_ends_with_an_error_when_its_interface_is_removed,
        the_end_of_a_cyclic_thread_that_panics_wakes_its_reader,
        the_error_for_a_taken_udp_port_names_the_port,
        bridge::each_end_of_a_switch_reaches_each_other_one,
        bridge::a_bridge_is_no_port_of_itself_and_its_name_is_taken_once,
        destinations::a_port_for_any_address_receives_frames_to_groups_and_to_other_stations,
        destinations::a_port_for_any_address_receives_no_broadcast_of_another_vlan,
        destinations::a_port_for_its_own_address_receives_no_frames_to_others_beside_one_for_any_address,
        batches::a_deadline_that_passes_while_frames_are_taken_is_met_before_the_rest_of_them,
        batches::a_port_whose_frames_are_left_for_a_deadline_does_not_keep_the_others_waiting,
        batches::frames_wait_in_as_large_a_buffer_as_datagrams,
        ethernet_ip::cyclic_packets_carry_the_dscp_of_the_qos_object_and_a_changed_one_from_the_next_connection_on,
        ethernet_ip::a_machine_knows_which_datagrams_went_to_everybody_and_receives_multicasts_of_its_group_only,
        former_address::an_interface_gets_back_the_address_that_it_had,
        former_address::an_interface_without_an_address_is_left_without_one,
        former_address::an_address_that_another_program_set_meanwhile_stays,
        gateway::a_gateway_replaces_the_one_that_was_set_before_and_no_route_of_others,
        gateway::the_interfaces_own_address_and_the_unspecified_one_are_no_gateway,
        gateway::a_gateway_that_no_network_of_the_interface_has_is_refused,
        interfaces::one_thread_serves_two_interfaces_with_one_wakeup_a_cycle,
        interfaces::two_buses_on_the_same_interface_of_the_host_have_sockets_of_their_own,
        interfaces::a_port_that_two_buses_need_on_one_interface_is_refused_and_named,
        interfaces::the_interface_that_is_removed_is_named,
        interfaces::connections_are_made_and_accepted_at_each_interface,
        interfaces::a_machine_connects_to_more_stations_than_clients_may_connect_to_it,
        interfaces::frames_of_many_stations_wake_the_thread_in_groups,
        interfaces::after_a_stall_the_frames_that_came_meanwhile_are_taken_before_what_is_overdue,
        interfaces::an_interface_whose_frames_are_left_for_a_deadline_does_not_keep_the_other_one_waiting,
        interfaces::an_arp_packet_makes_every_bus_on_its_interface_look_at_the_neighbours_again,
        neighbours::a_wrong_neighbour_is_seen_and_corrected,
        recorder::frames_come_out_in_order_after_the_ring_wrapped_many_times,
        recorder::a_listener_that_is_busy_for_too_long_gets_the_number_of_missed_frames,
        recorder::no_frame_of_another_interface_and_none_while_paused_is_seen,
        recorder::a_frame_has_the_instant_at_which_it_passed,
        recorder::a_removed_interface_is_reported_as_an_error,
        recorder::a_tag_that_the_kernel_removed_from_a_received_frame_is_put_back,
        streams::a_client_that_sends_single_bytes_and_closes_its_side_receives_every_answer,
        streams::a_connection_that_the_machine_closes_first_sends_its_last_bytes,
        streams::a_client_that_does_not_read_is_disconnected_and_delays_nobody,
        streams::clients_beyond_the_limit_are_disconnected_and_the_others_stay,
        streams::a_machine_is_informed_that_nobody_listens_and_connects_once_somebody_does,
        streams::the_error_for_a_taken_tcp_port_names_its_user,
    ])
}

/// Runs two stations until each has sent and received 300 images, which arrive in order.
fn exchange(cable: Cable) {
    let network = TestNetwork::new();
    let station = |peer: usize| {
        move |interface: &Interface| {
            let peer = SocketAddrV4::new(ADDRESSES[peer], machines::UDP_PORT);
            Station::new(cable, interface.mac(), peer, clock::now())
        }
    };
    let stations = [network.start(0, station(1)), network.start(1, station(0))];
    for station in &stations {
        station.until("300 images each way", 300);
    }
    for station in stations.map(test_network::Running::stop) {
        assert_eq!(station.task.ups, 1);
        assert_eq!(station.driver.machine().counters().malformed, 0);
        assert_eq!(station.driver.machine().out_of_order, 0);
        assert_eq!(station.driver.statistics().send_errors, 0);
        assert_eq!(station.driver.statistics().allocations, Some(0), "the cyclic thread allocated");
    }
}

fn two_stations_exchange_images_over_raw_ethernet() {
    exchange(Cable::Untagged);
}

fn two_stations_exchange_images_in_priority_tagged_frames() {
    exchange(Cable::PriorityTagged);
}

fn two_stations_exchange_images_over_udp() {
    exchange(Cable::Udp);
}

fn frames_of_another_vlan_are_discarded() {
    let network = TestNetwork::new();
    let station = |cable| {
        move |interface: &Interface| {
            let nobody = SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0);
            Station::new(cable, interface.mac(), nobody, clock::now())
        }
    };
    let (left, right) =
        (network.start(0, station(Cable::Vlan(5))), network.start(1, station(Cable::Untagged)));
    left.until("50 images each way at the end in the VLAN", 50);
    assert!(left.stop().driver.machine().counters().sent >= 50);
    assert_eq!(right.stop().driver.machine().counters().received, 0);
}

fn cyclic_requests_are_answered_each_once() {
    let network = TestNetwork::new();
    let (left, right) = (network.start(0, Echo::asks), network.start(1, Echo::answers));
    left.until("500 answers", 500);
    let left = left.stop();
    right.stop();
    let left = left.driver.machine();
    assert!(left.answered <= left.asked, "{left:?}");
    assert_eq!(left.out_of_order, 0, "{left:?}");
}

fn a_driver_ends_with_an_error_when_its_interface_is_removed() {
    let network = TestNetwork::new();
    let station = |interface: &Interface| {
        let nobody = SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0);
        Station::new(Cable::Untagged, interface.mac(), nobody, clock::now())
    };
    let left = network.start(0, station);
    let TestNetwork { ends: [keep, gone] } = network;
    // A veth end is removed with its namespace, and takes the other end with it.
    drop(gone);
    let finished = left.join();
    assert!(matches!(finished.result, Err(DriverError::InterfaceGone { .. })), "{:?}", finished.result);
    drop(keep);
}

fn the_end_of_a_cyclic_thread_that_panics_wakes_its_reader() {
    let network = TestNetwork::new();
    let reader = Notifier::new().unwrap();
    let mut thread = network.run(0, |interface| {
        let nobody = SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0);
        let station = Station::new(Cable::Untagged, interface.mac(), nobody, clock::now());
        let waker = Notifier::new().unwrap();
        let driver = Driver::new(station, interface.clone(), waker.clone()).unwrap();
        CyclicThread::start(driver, Fault, waker, reader.clone()).unwrap()
    });
    assert_eq!(thread.next_notice(), Received::Nothing);
    thread.send(()).unwrap();
    let limit = Timespec::try_from(TIMEOUT).unwrap();
    let woken = poll(&mut [PollFd::new(&reader, PollFlags::IN)], Some(&limit)).unwrap();
    assert_eq!((woken, thread.next_notice()), (1, Received::Ended));
    thread.join().unwrap_err();
}

/// Panics at its first command.
#[derive(Debug)]
struct Fault;

impl Task<Station> for Fault {
    type Command = ();
    type Notice = ();

    fn command(
        &mut self,
        _: Instant,
        _: &mut Station,
        _: &Statistics,
        (): (),
        _: &mut NoticeSender<()>,
    ) -> ControlFlow<()> {
        unreachable!("what a fault of the program does")
    }

    fn event(
        &mut self,
        _: Instant,
        _: &mut Station,
        _: LinkEvent,
        _: &mut NoticeSender<()>,
    ) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

fn the_error_for_a_taken_udp_port_names_the_port() {
    let network = TestNetwork::new();
    let message = network.run(0, |interface| {
        let _first = OpenPort::open(interface, PortRequest::Udp(4000)).unwrap();
        OpenPort::open(interface, PortRequest::Udp(4000)).unwrap_err().to_string()
    });
    assert!(message.contains("UDP port 4000") && message.contains(" at 0.0.0.0:4000;"), "{message}");
}
