//! Captured frames for tests; `vectors/README.md` names their source.

/// Returns the frame in a hex file of `vectors/`, without its comment line.
pub(crate) fn frame(text: &str) -> Vec<u8> {
    text.lines()
        .filter(|line| !line.starts_with('#'))
        .flat_map(str::split_whitespace)
        .map(|byte| u8::from_str_radix(byte, 16).expect("a hex file holds hex bytes"))
        .collect()
}

/// Returns the UDP payload of a captured IPv4 frame: 14 bytes Ethernet, 20 bytes IP, 8 bytes UDP.
pub(crate) fn datagram(text: &str) -> Vec<u8> {
    frame(text).split_off(42)
}

macro_rules! captured {
    ($($name:ident: $file:literal,)*) => {
        $(pub(crate) const $name: &str = include_str!(concat!("../vectors/", $file, ".hex"));)*

        /// Every captured frame.
        pub(crate) const ALL: &[(&str, &str)] = &[$(($file, $name),)*];
    };
}

captured! {
    ALARM_ACK_HIGH_CPU: "alarm_ack_high_cpu",
    ALARM_ACK_RTA_HIGH_CPU: "alarm_ack_rta_high_cpu",
    ALARM_ACK_RTA_HIGH_DEV: "alarm_ack_rta_high_dev",
    ALARM_ACK_RTA_LOW_CPU: "alarm_ack_rta_low_cpu",
    ALARM_ACK_RTA_LOW_DEV: "alarm_ack_rta_low_dev",
    ALARM_DIAG_ACK_CPU: "alarm_diag_ack_cpu",
    ALARM_DIAG_NOTIF: "alarm_diag_notif",
    ALARM_DIAG_STD_REMOVE: "alarm_diag_std_remove",
    ALARM_DIAG_UPDATE_APPEARS: "alarm_diag_update_appears",
    ALARM_DIAG_UPDATE_OTHERS_REMAIN: "alarm_diag_update_others_remain",
    ALARM_DIAG_USI_DISAPPEARS: "alarm_diag_usi_disappears",
    ALARM_ERR_RTA_CPU: "alarm_err_rta_cpu",
    ALARM_ERR_RTA_CPU_REMOVED: "alarm_err_rta_cpu_removed",
    ALARM_ERR_RTA_DEV: "alarm_err_rta_dev",
    ALARM_ERR_RTA_DEV_REMOVED_REPLY: "alarm_err_rta_dev_removed_reply",
    ALARM_PROCESS_NOTIF: "alarm_process_notif",
    IM0_READ_REQ: "im0_read_req",
    IM0_READ_REQ_IF: "im0_read_req_if",
    IM0_READ_RES: "im0_read_res",
    IM0_READ_RES_IF: "im0_read_res_if",
    APPREADY_REQ: "appready_req",
    APPREADY_RES: "appready_res",
    CONNECT_REQ: "connect_req",
    CONNECT_RES: "connect_res",
    DCP_SET_REQ: "dcp_set_req",
    DCP_SET_RES: "dcp_set_res",
    IDENT_OK_PNET: "ident_ok_pnet",
    PRMEND_REQ: "prmend_req",
    PRMEND_RES: "prmend_res",
    WRITE_REQ: "write_req",
    WRITE_RES: "write_res",
    ECHO_CPU_8001: "echo_cpu_8001",
    ECHO_DEV_8000: "echo_dev_8000",
    RTC_CPU_8001: "rtc_cpu_8001",
    RTC_DEV_8000: "rtc_dev_8000",
}
