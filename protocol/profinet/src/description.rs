//! Description of a device: identity, modules and submodules. One description serves the IO-Device, the IO-Controller that
//! expects it, and the GSDML file that an engineering system imports.

/// Who made the device and which one it is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Identity {
    /// VendorID, as PROFIBUS & PROFINET International assigns it.
    pub vendor: u16,
    /// DeviceID, as the vendor assigns it.
    pub device: u16,
}

/// A submodule: the unit that has data and a provider status.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Submodule {
    /// Subslot number.
    pub subslot: u16,
    /// SubmoduleIdentNumber.
    pub ident: u32,
    /// Bytes from device to controller.
    pub input_len: u16,
    /// Bytes from controller to device.
    pub output_len: u16,
    /// Indices of the parameter records that a controller may write before PrmEnd.
    pub parameters: &'static [u16],
}

/// A module: what is in one slot.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Module {
    /// Slot number.
    pub slot: u16,
    /// ModuleIdentNumber.
    pub ident: u32,
    /// The submodules, by ascending subslot.
    pub submodules: &'static [Submodule],
}

/// A device.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Description {
    /// Who made it.
    pub identity: Identity,
    /// Type of the station, at most 25 characters, in DCP and as a name for people.
    pub station_type: &'static str,
    /// OrderID of I&M0, at most 20 characters.
    pub order_id: &'static str,
    /// Serial number of I&M0, at most 16 characters.
    pub serial_number: &'static str,
    /// Hardware revision of I&M0.
    pub hardware_revision: u16,
    /// Software revision of I&M0: major, minor, patch.
    pub software_revision: [u8; 3],
    /// Shortest cycle that the device serves, in 31.25 µs: MinDeviceInterval of its GSDML file.
    pub min_device_interval: u16,
    /// The modules, by ascending slot.
    pub modules: &'static [Module],
}

/// Subslot of the first interface of a device.
pub const INTERFACE_SUBSLOT: u16 = 0x8000;

/// Subslot of the first port of the first interface.
pub const PORT_SUBSLOT: u16 = 0x8001;

impl Description {
    /// Returns the module in a slot.
    #[must_use]
    pub fn module(&self, slot: u16) -> Option<&'static Module> {
        self.modules.iter().find(|module| module.slot == slot)
    }

    /// Returns the submodule in a subslot.
    #[must_use]
    pub fn submodule(&self, slot: u16, subslot: u16) -> Option<&'static Submodule> {
        self.module(slot)?.submodule(subslot)
    }

    /// Returns every submodule with its slot, by ascending slot and subslot.
    pub fn submodules(&self) -> impl Iterator<Item = (u16, &'static Submodule)> {
        self.modules
            .iter()
            .flat_map(|module| module.submodules.iter().map(|submodule| (module.slot, submodule)))
    }
}

impl Module {
    /// Returns the submodule in a subslot.
    #[must_use]
    pub fn submodule(&self, subslot: u16) -> Option<&'static Submodule> {
        self.submodules.iter().find(|submodule| submodule.subslot == subslot)
    }
}
