//! The catalogue of EtherCAT SubDevices.

use std::fmt;

use device_files::{Esi, EsiDevice, EsiMailbox, EsiModule, EsiPdo, ObjectDictionary};

use super::{Digits, FileText, line};

/// Lists the catalogue.
pub(super) fn list(text: &mut String, esi: &Esi) -> fmt::Result {
    let (devices, modules) = (esi.devices.len(), esi.modules.len());
    line(
        text,
        0,
        format_args!(
            "ESI: {}, vendor 0x{:08X}; {devices} devices, {modules} modules",
            FileText(&esi.vendor),
            esi.vendor_id
        ),
    )?;
    for device in &esi.devices {
        list_device(text, device)?;
    }
    for module in &esi.modules {
        list_module(text, module)?;
    }
    Ok(())
}

fn list_device(text: &mut String, device: &EsiDevice) -> fmt::Result {
    let (kind, name) = (FileText(&device.kind), FileText(&device.name));
    line(text, 0, format_args!(""))?;
    let (product, revision) = (device.product_code, device.revision);
    line(text, 0, format_args!("device {kind}: product 0x{product:08X}, revision 0x{revision:08X}: {name}"))?;
    if !device.fmmus.is_empty() {
        line(text, 2, format_args!("FMMUs: {}", FileText(&device.fmmus.join(", "))))?;
    }
    for (number, manager) in device.sync_managers.iter().enumerate() {
        let size =
            manager.default_size.map_or("size from the PDOs".to_owned(), |size| format!("{size} bytes"));
        let limits = match (manager.min_size, manager.max_size) {
            (None, None) => String::new(),
            (least, most) => {
                let most = most.map_or("any".to_owned(), |most| most.to_string());
                format!(" ({} to {most})", least.unwrap_or(0))
            }
        };
        let (address, control) = (manager.start_address, manager.control);
        let state = if manager.is_enabled { "" } else { ", off" };
        let usage = if manager.usage.is_empty() { "unused" } else { &manager.usage };
        let usage = FileText(usage);
        line(
            text,
            2,
            format_args!(
                "SM{number} {usage}: 0x{address:04X}, {size}{limits}, control 0x{control:02X}{state}"
            ),
        )?;
    }
    list_pdos(text, "RxPDO", &device.rx_pdos)?;
    list_pdos(text, "TxPDO", &device.tx_pdos)?;
    list_mailbox(text, device.mailbox.as_ref())?;
    for mode in &device.dc_modes {
        let (name, assign) = (FileText(&mode.name), mode.assign_activate);
        let (sync0, shift) = (mode.sync0_cycle_ns, mode.sync0_shift_ns);
        line(
            text,
            2,
            format_args!("clock {name}: AssignActivate 0x{assign:04X}, SYNC0 {sync0} ns, shift {shift} ns"),
        )?;
    }
    for slot in &device.slots {
        let idents: Vec<_> = slot.module_idents.iter().map(|ident| format!("0x{ident:08X}")).collect();
        let modules = [idents, slot.module_classes.clone()].concat().join(" ");
        let default = slot.default_ident.map(|ident| format!("; default 0x{ident:08X}")).unwrap_or_default();
        let (index, pdo) = (slot.index_increment, slot.pdo_increment);
        let (name, least, most) = (FileText(&slot.name), slot.min_instances, slot.max_instances);
        line(
            text,
            2,
            format_args!(
                "slot {name}: {least} to {most} modules of {}{default}; each moves objects by 0x{index:X} and PDOs by 0x{pdo:X}",
                FileText(&modules)
            ),
        )?;
    }
    if let Some(eeprom) = &device.eeprom {
        let (size, config) = (eeprom.byte_size, Digits(&eeprom.config_data));
        line(text, 2, format_args!("EEPROM: {size} bytes, configuration {config}"))?;
    }
    list_dictionary(text, device.dictionary.as_ref())?;
    match &device.dictionary_file {
        Some(file) => line(text, 2, format_args!("dictionary in the file {}", FileText(file))),
        None => Ok(()),
    }
}

fn list_module(text: &mut String, module: &EsiModule) -> fmt::Result {
    let (kind, name) = (FileText(&module.kind), FileText(&module.name));
    line(text, 0, format_args!(""))?;
    line(text, 0, format_args!("module 0x{:08X}: {kind}: {name}", module.ident))?;
    list_pdos(text, "RxPDO", &module.rx_pdos)?;
    list_pdos(text, "TxPDO", &module.tx_pdos)?;
    list_mailbox(text, module.mailbox.as_ref())?;
    list_dictionary(text, module.dictionary.as_ref())
}

fn list_pdos(text: &mut String, word: &str, pdos: &[EsiPdo]) -> fmt::Result {
    for pdo in pdos {
        let manager = pdo.sync_manager.map_or("not assigned".to_owned(), |manager| format!("SM{manager}"));
        let fixed = if pdo.is_fixed { ", fixed" } else { "" };
        let mandatory = if pdo.is_mandatory { ", mandatory" } else { "" };
        let excludes: Vec<_> = pdo.excludes.iter().map(|index| format!("0x{index:04X}")).collect();
        let excludes =
            if excludes.is_empty() { String::new() } else { format!(", not with {}", excludes.join(" ")) };
        let (index, name, bits) = (pdo.index, FileText(&pdo.name), pdo.bits);
        line(
            text,
            2,
            format_args!("{word} 0x{index:04X} {name}: {bits} bits, {manager}{fixed}{mandatory}{excludes}"),
        )?;
        for entry in &pdo.entries {
            let (index, subindex, bits) = (entry.index, entry.subindex, entry.bits);
            let (data_type, name) = (FileText(&entry.data_type), FileText(&entry.name));
            match index {
                0 => line(text, 4, format_args!("{bits} bits unused"))?,
                index => line(
                    text,
                    4,
                    format_args!("0x{index:04X}:{subindex:02X} {name}: {data_type}, {bits} bits"),
                )?,
            }
        }
    }
    Ok(())
}

fn list_mailbox(text: &mut String, mailbox: Option<&EsiMailbox>) -> fmt::Result {
    let Some(mailbox) = mailbox else { return Ok(()) };
    line(text, 2, format_args!("mailbox: {}", mailbox.protocols.join(", ")))?;
    let Some(coe) = &mailbox.coe else { return Ok(()) };
    let options = [
        ("SDO information", coe.has_sdo_info),
        ("complete access", coe.has_complete_access),
        ("PDO assignment", coe.has_pdo_assign),
        ("PDO configuration", coe.has_pdo_config),
        ("PDO upload", coe.has_pdo_upload),
    ];
    let options: Vec<_> = options.iter().filter(|(_, has)| *has).map(|(name, _)| *name).collect();
    line(
        text,
        2,
        format_args!("CoE: {}", if options.is_empty() { "SDO only".to_owned() } else { options.join(", ") }),
    )?;
    for command in &coe.init_commands {
        let (transitions, data) = (command.transitions.join(" "), Digits(&command.data));
        let (index, subindex, comment) = (command.index, command.subindex, FileText(&command.comment));
        let transitions = FileText(&transitions);
        line(
            text,
            4,
            format_args!("at {transitions} write 0x{index:04X}:{subindex:02X} = {data} {comment}"),
        )?;
    }
    Ok(())
}

fn list_dictionary(text: &mut String, dictionary: Option<&ObjectDictionary>) -> fmt::Result {
    let Some(dictionary) = dictionary else { return Ok(()) };
    let entries: usize = dictionary.objects.iter().map(|object| object.entries.len()).sum();
    line(text, 2, format_args!("dictionary: {} objects with {entries} entries", dictionary.objects.len()))
}
