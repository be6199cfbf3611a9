//! The mailbox of a device: what comes in, what goes out, and repetitions.

use alloc::vec;

use super::SubDevice;
use crate::al::AlState;
use crate::dictionary::ProcessData;
use crate::event::Sink;
use crate::layout::Usage;
use crate::mailbox::{Context, MailFault, Mailbox};

impl SubDevice {
    /// Serves the message in the mailbox, if the answer to the one before has left.
    pub(super) fn receive_mail(&mut self, sink: &mut Sink<'_>) {
        let state = self.al.state();
        let Some((index, _)) = self.layout.find(Usage::MailboxReceive) else { return };
        let Some(mailbox) = self.mailbox.as_mut().filter(|_| state > AlState::Init) else { return };
        if mailbox.outgoing(&self.dictionary).is_none()
            && let Some(message) = self.esc.take(index)
        {
            let process = ProcessData { inputs: &self.inputs, outputs: &mut self.outputs };
            let (dictionary, file, mailbox_len) = (&mut self.dictionary, &mut self.file, message.len());
            mailbox.receive(message, &mut Context { state, mailbox_len, dictionary, process, file, sink });
        }
        self.resize_process_data();
        self.send_mail();
    }

    /// Applies the process data that the MainDevice has chosen; it can choose them only while they are not exchanged. The
    /// entries keep their values, wherever these are then.
    pub(super) fn resize_process_data(&mut self) {
        if !self.dictionary.take_choice() || self.al.state() != AlState::PreOp {
            return;
        }
        let numbers = self.dictionary.mappable_numbers(&self.inputs, &self.outputs);
        for (usage, data) in [(Usage::Outputs, &mut self.outputs), (Usage::Inputs, &mut self.inputs)] {
            let len = self.dictionary.process_data_len(usage);
            self.layout.set_len(usage, len);
            *data = vec![0; len.into()].into_boxed_slice();
        }
        self.dictionary.map_process_data();
        for number in numbers {
            // The entry exists, and is as long as before.
            let _ = self.dictionary.set_number(number, &mut self.inputs, &mut self.outputs);
        }
    }

    /// Puts the next message into the mailbox, if that is empty.
    pub(super) fn send_mail(&mut self) {
        let Some((index, _)) = self.layout.find(Usage::MailboxSend) else { return };
        let Some(mailbox) = &mut self.mailbox else { return };
        if let Some(message) = mailbox.outgoing(&self.dictionary)
            && self.esc.put(index, message)
        {
            mailbox.handed_out();
        }
    }

    /// Notes that the MainDevice read the mailbox; what a repetition has taken out of it goes back.
    pub(super) fn note_read_mail(&mut self) {
        let Some((index, _)) = self.layout.find(Usage::MailboxSend) else { return };
        if let Some(message) = self.mailbox.as_mut().and_then(Mailbox::was_read) {
            self.esc.put(index, message);
        }
    }

    /// Puts the message that the MainDevice read last into the mailbox once more, if it asks for it. The message that is
    /// there comes after that one: the MainDevice recognises by the counter what it has already.
    pub(super) fn repeat_mail(&mut self) {
        let Some((index, _)) = self.layout.find(Usage::MailboxSend) else { return };
        let Some(mailbox) = self.mailbox.as_mut().filter(|_| self.al.state() > AlState::Init) else { return };
        let request = self.esc.sync_manager(index).repeat_request();
        if !mailbox.is_repetition_requested(request) {
            return;
        }
        if let Some((message, replaces)) = mailbox.repeat() {
            if replaces {
                // This empties the mailbox.
                self.esc.lock(index, true);
                self.esc.lock(index, false);
            }
            self.esc.put(index, message);
        }
        self.esc.acknowledge_repeat(index, request);
    }

    pub(crate) fn set_mail_fault(&mut self, fault: Option<MailFault>) {
        if let Some(mailbox) = &mut self.mailbox {
            mailbox.set_fault(fault);
        }
    }

    pub(super) fn reset_mailbox(&mut self) {
        if let Some(mailbox) = &mut self.mailbox {
            mailbox.reset();
        }
        if let Some((index, _)) = self.layout.find(Usage::MailboxSend) {
            self.esc.acknowledge_repeat(index, false);
        }
    }

    /// Opens the mailbox with the length that the MainDevice chose, which may be shorter than the EEPROM says.
    pub(super) fn start_mailbox(&mut self) {
        self.lock_mailbox(false);
        if let (Some(mailbox), Some((index, _))) = (&mut self.mailbox, self.layout.find(Usage::MailboxSend)) {
            mailbox.start(self.esc.sync_manager(index).len);
        }
        // Its bit may be set from before.
        self.repeat_mail();
    }

    /// Closes both mailboxes, or opens them, empty.
    pub(super) fn lock_mailbox(&mut self, locked: bool) {
        self.lock([Usage::MailboxReceive, Usage::MailboxSend], locked);
    }
}
