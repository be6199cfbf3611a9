//! Messages for the user that explain why there is no connection, and what to check.

pub(super) const NO_STATION: &str = "no station answers to the device's name: check the cable, that the device is on, \
     and its name";
pub(super) const NO_SET: &str = "the device is there but does not answer when its IP address is set by DCP: check \
     that no switch or second controller filters it";
pub(super) const NO_RPC: &str = "the device is there but does not answer calls on UDP port 34964: check both IP \
     addresses, the subnet mask and firewalls";
pub(super) const ADDRESS_TAKEN: &str = "the device does not answer calls, and reports by DCP that another station has the IP \
     address that it is to have: find that station, or choose another address";
pub(super) const NO_ARP: &str = "the device is there but does not answer ARP for its IP address: check its address, the \
     subnet mask, and switches that filter";
pub(super) const WRONG_IDENTITY: &str = "the station of this name is another device than described (the status is its \
     VendorID and DeviceID): check the name and the description";
pub(super) const NAME_TWICE: &str =
    "two stations answer to the device's name: give one of them another name, by DCP or its own tool";
pub(super) const ADDRESS_REFUSED: &str = "the device refused the IP address that was set by DCP (the status is its \
     BlockError): look whether another controller or DHCP holds its address";
pub(super) const ADDRESS_TWICE: &str = "another station has this IP address, which the device has or is to have: give one of them another address";
pub(super) const OWN_ADDRESS_TWICE: &str =
    "another station has this IP address, which is the controller's: give one of them another address";
pub(super) const WRONG_NEIGHBOUR: &str = "another station has this IP address in the host's table of neighbours, which may \
     not be corrected: allow CAP_NET_ADMIN, or remove the entry";
pub(super) const NOT_READY: &str = "the device took its parameters but did not report that it is ready: look at the \
     device, and at firewalls for UDP port 34964";
pub(super) const NO_CYCLIC: &str = "the device is connected but sends no cyclic frames: check the transport (udp or \
     rt1) and firewalls for UDP port 34962";
pub(super) const WATCHDOG: &str = "no cyclic frame came within the data hold time: check the cable and the load on \
     both sides, or allow more watchdog cycles";
pub(super) const NO_ALARM_ACK: &str = "the device sent an alarm and then did not take its acknowledgement";
pub(super) const REJECTED: &str = "the device rejected the call by a status of RPC (C706, appendix E)";
pub(super) const UNFIT_ANSWER: &str =
    "the device's answer does not fit the request: compare both in a capture";
pub(super) const WRONG_FRAME_ID: &str = "the device gave cyclic data a FrameID that is not one of cyclic data (the status \
     is that FrameID): look at its answer to the Connect in a capture";
pub(super) const TOO_LONG: &str =
    "the request does not fit into one call: leave modules out or shorten parameters";
pub(super) const NO_MODULE: &str = "the device has no module in a slot where one is expected (the status is slot and \
     subslot): compare its modules with the description";
pub(super) const WRONG_MODULE: &str = "the device has another module in a slot than expected (the status is slot and \
     subslot): compare its modules with the description";
pub(super) const WRONG_SUBMODULE: &str = "the device has another submodule, or none, in a subslot (the status is slot \
     and subslot): compare its modules with the description";
