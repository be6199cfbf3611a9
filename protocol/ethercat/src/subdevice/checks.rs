//! Whether the MainDevice has configured a device for a state: sync managers and SYNC signals.

use machine::Instant;

use super::SubDevice;
use crate::al::{AlState, AlStatusCode};
use crate::description::{CONFIGURED_MODULES, DETECTED_MODULES};
use crate::event::{Event, Sink};
use crate::layout::{SyncManagerLayout, Usage};

impl SubDevice {
    /// Leaves a state whose sync managers are no longer as the state needs them.
    pub(super) fn watch_sync_managers(&mut self, now: Instant, sink: &mut Sink<'_>) {
        let before = self.al.state();
        if self.al.error() != AlStatusCode::NO_ERROR {
            return;
        }
        let Err(code) = self.check_sync_managers(before) else { return };
        let state = code.highest_state();
        self.al.fail(state, code);
        self.show_status();
        self.enter(now, before);
        sink.push(Event::StateChanged { state, code });
    }

    /// Returns whether the MainDevice has configured the device for a state.
    pub(super) fn check(&self, state: AlState) -> Result<(), AlStatusCode> {
        self.check_sync_managers(state)?;
        if state == AlState::SafeOp && self.al.state() < AlState::SafeOp {
            self.check_modules()?;
        }
        match (state, self.esc.sync_signals()) {
            (AlState::SafeOp, (true, false)) if self.al.state() < AlState::SafeOp => {
                Err(AlStatusCode::INVALID_SYNC)
            }
            (AlState::Op, _) if self.uses_sync && self.esc.sync_period().is_none() => {
                Err(AlStatusCode::NO_SYNC_ERROR)
            }
            _ => Ok(()),
        }
    }

    fn check_sync_managers(&self, state: AlState) -> Result<(), AlStatusCode> {
        match state {
            AlState::Init => Ok(()),
            AlState::Boot => {
                if !self.description.has_files() {
                    return Err(AlStatusCode::BOOT_NOT_SUPPORTED);
                }
                self.check_mailbox().map_err(|()| AlStatusCode::INVALID_BOOT_MAILBOX)
            }
            AlState::PreOp | AlState::SafeOp | AlState::Op => {
                self.check_mailbox().map_err(|()| AlStatusCode::INVALID_MAILBOX)?;
                if state == AlState::PreOp { Ok(()) } else { self.check_all_process_data() }
            }
        }
    }

    /// Compares the controller's list of modules with the detected one, if it wrote one (ETG.5001.1, objects F030 and F050).
    fn check_modules(&self) -> Result<(), AlStatusCode> {
        let count = |index| self.dictionary.get(index, 0).and_then(<[u8]>::first).copied().unwrap_or(0);
        let (configured, detected) = (count(CONFIGURED_MODULES), count(DETECTED_MODULES));
        let ident = |index, slot, count| {
            let entry = self.dictionary.get(index, slot).filter(|_| slot <= count);
            entry.and_then(<[u8]>::first_chunk).map_or(0, |ident| u32::from_le_bytes(*ident))
        };
        let is_same =
            |slot| ident(CONFIGURED_MODULES, slot, configured) == ident(DETECTED_MODULES, slot, detected);
        let matches = !self.checks_modules || configured == 0 || (1..=configured.max(detected)).all(is_same);
        if matches { Ok(()) } else { Err(AlStatusCode::OTHER_MODULES) }
    }

    fn check_mailbox(&self) -> Result<(), ()> {
        for usage in [Usage::MailboxReceive, Usage::MailboxSend] {
            let Some((index, layout)) = self.layout.find(usage) else { continue };
            let unit = self.esc.sync_manager(index);
            let fits = unit.guards() && unit.len >= 32 && unit.len <= layout.len;
            (fits && self.is_as_planned(index, layout)).then_some(()).ok_or(())?;
        }
        Ok(())
    }

    fn check_all_process_data(&self) -> Result<(), AlStatusCode> {
        self.check_process_data(Usage::Outputs).map_err(|()| AlStatusCode::INVALID_OUTPUTS)?;
        self.check_process_data(Usage::Inputs).map_err(|()| AlStatusCode::INVALID_INPUTS)
    }

    fn check_process_data(&self, usage: Usage) -> Result<(), ()> {
        let mut managers = self.layout.iter().enumerate().filter(|(_, layout)| layout.usage == usage);
        let all_fit = managers.all(|(index, layout)| {
            let unit = self.esc.sync_manager(index);
            match layout.len {
                0 => !unit.guards(),
                len => unit.guards() && unit.len == len && self.is_as_planned(index, layout),
            }
        });
        all_fit.then_some(()).ok_or(())
    }

    /// Returns whether a sync manager has the start, mode and direction that the EEPROM names.
    fn is_as_planned(&self, index: usize, layout: SyncManagerLayout) -> bool {
        let control = self.esc.sync_manager_control(index);
        self.esc.sync_manager(index).start == layout.start && control & 0x0F == layout.control & 0x0F
    }
}
