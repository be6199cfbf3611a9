//! The options by which a command takes a device from its file: the file, and what is chosen from it.

use std::error::Error;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use device_files::{
    ChoiceError, ChoiceFileError, ChosenDevice, DeviceChoice, DeviceFile, MOST_BYTES, ModulePlace, ReadError,
    choose,
};

/// A device of a file.
#[derive(clap::Args, Clone, Debug)]
pub struct DeviceOptions {
    /// The file: a GSDML (PROFINET), an EDS (EtherNet/IP) or an ESI (EtherCAT).
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Choice from it.
    #[command(flatten)]
    pub choice: ChoiceOptions,
}

/// Choice from a device file.
#[derive(clap::Args, Clone, Debug)]
pub struct ChoiceOptions {
    /// GSDML: the access point.
    #[arg(long, value_name = "ID")]
    access_point: Option<String>,
    /// GSDML and ESI: a module in a slot; GSDML: a submodule in a subslot.
    ///
    /// `none` leaves it empty. Repeat it for each. Slots of an ESI count from 1.
    #[arg(long = "module", value_name = "SLOT[.SUBSLOT]=ID", value_parser = module)]
    modules: Vec<(ModulePlace, String)>,
    /// EDS: the connection, by name or number.
    #[arg(long, value_name = "NAME")]
    connection: Option<String>,
    /// ESI: the device, by type or name.
    #[arg(long, value_name = "NAME")]
    device_name: Option<String>,
    /// ESI: the revision.
    #[arg(long, value_name = "0x...", value_parser = hex::<u32>)]
    revision: Option<u32>,
    /// ESI: the process data objects that are assigned.
    #[arg(long = "pdo", value_name = "INDEX,...", value_delimiter = ',', value_parser = hex::<u16>)]
    pdos: Option<Vec<u16>>,
    /// The choice as a TOML file.
    ///
    /// --print-config writes such a file; options replace what it chooses.
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Print the whole choice as TOML and end.
    #[arg(long)]
    pub print_config: bool,
}

fn module(text: &str) -> Result<(ModulePlace, String), String> {
    let (place, id) = text.split_once('=').ok_or("must be SLOT=ID or SLOT.SUBSLOT=ID")?;
    Ok((place.parse().map_err(|error| format!("{error}"))?, id.to_owned()))
}

fn hex<N: TryFrom<u32>>(text: &str) -> Result<N, String> {
    let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    let value = digits.map_or_else(|| text.parse(), |digits| u32::from_str_radix(digits, 16));
    let fitting = value.ok().and_then(|value| N::try_from(value).ok());
    fitting.ok_or_else(|| "must be a number such as 0x1A00".to_owned())
}

impl DeviceOptions {
    /// Reads the file, and makes the chosen device.
    ///
    /// # Errors
    ///
    /// The file cannot be read or is refused, or the choice makes no device; see [`is_usage`].
    pub fn choose(&self) -> anyhow::Result<ChosenDevice> {
        let file = read_device_file(&self.file)?;
        Ok(choose(&file, &self.choice.to_choice()?)?)
    }
}

impl ChoiceOptions {
    /// Returns the choice of the options over that of their file.
    ///
    /// # Errors
    ///
    /// The file cannot be read or is refused.
    pub fn to_choice(&self) -> anyhow::Result<DeviceChoice> {
        let of_file = read_toml(self.config.as_deref(), DeviceChoice::from_toml)?;
        let options = DeviceChoice {
            access_point: self.access_point.clone(),
            connection: self.connection.clone(),
            device_name: self.device_name.clone(),
            revision: self.revision,
            pdos: self.pdos.clone(),
            modules: self.modules.iter().cloned().collect(),
        };
        Ok(of_file.replaced_by(options))
    }
}

/// Reads a device file.
///
/// # Errors
///
/// It cannot be read, or is refused.
pub fn read_device_file(path: &Path) -> anyhow::Result<DeviceFile> {
    Ok(device_files::read(&path.display().to_string(), read_bytes(path)?)?)
}

/// A file that is not text.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{file}: byte {at} is not UTF-8; save the file as UTF-8 text")]
pub struct NotText {
    /// The file.
    pub file: String,
    /// Number of the first byte that is not, from 0.
    pub at: usize,
}

/// Reads a text file of at most the bytes that a reader accepts.
fn read_text(path: &Path) -> anyhow::Result<String> {
    let text = String::from_utf8(read_bytes(path)?);
    Ok(text.map_err(|error| NotText {
        file: path.display().to_string(),
        at: error.utf8_error().valid_up_to(),
    })?)
}

/// Reads a file of at most the bytes that a reader accepts.
fn read_bytes(path: &Path) -> anyhow::Result<Vec<u8>> {
    setup::read_plain_file(path, MOST_BYTES as u64).with_context(|| format!("cannot read {}", path.display()))
}

/// Reads a TOML file, such as a choice or a script; the default without one.
///
/// # Errors
///
/// It cannot be read, is not UTF-8 ([`NotText`]), or is refused; the error names the file.
pub fn read_toml<T, E>(path: Option<&Path>, from_toml: fn(&str) -> Result<T, E>) -> anyhow::Result<T>
where
    T: Default,
    E: Error + Send + Sync + 'static,
{
    let Some(path) = path else { return Ok(T::default()) };
    from_toml(&read_text(path)?).with_context(|| path.display().to_string())
}

/// Returns true for an error that another file or choice corrects.
#[must_use]
pub fn is_usage(error: &anyhow::Error) -> bool {
    let missing = error.downcast_ref::<io::Error>();
    error.is::<ReadError>()
        || error.is::<ChoiceError>()
        || error.is::<ChoiceFileError>()
        || error.is::<NotText>()
        || missing.is_some_and(|error| error.kind() == io::ErrorKind::NotFound)
}
