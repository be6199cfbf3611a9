//! The objects of a device that explicit messages read and set (volume 1, chapter 5; volume 2, chapter 5).

mod assembly;
mod connection_manager;
mod ethernet_link;
mod identity;
mod message_router;
mod port;
mod qos;
mod tcp_ip;

pub(super) use assembly::AssemblyData;
pub(super) use connection_manager::ManagerCounters;
pub(super) use ethernet_link::ReportedLink;
pub(super) use identity::{IoState, write_identity_item};
pub(super) use message_router::multiple_service;
pub use port::PORT_NUMBER;
pub(super) use qos::Qos;
pub(super) use tcp_ip::{MULTICASTS, Network};

use super::cip::{General, ObjectClass, Target, Violation, service};
use super::description::Description;
use super::{Reader, Writer};

/// State of all objects.
#[derive(Debug)]
pub(super) struct Device {
    pub(super) description: &'static Description,
    pub(super) serial_number: u32,
    pub(super) network: Network,
    pub(super) link: ReportedLink,
    pub(super) qos: Qos,
    pub(super) manager: ManagerCounters,
    pub(super) io: IoState,
    /// Whether the request comes from another host than the owner of the outputs. Such a request cannot set what the owner
    /// depends on.
    pub(super) locked: bool,
    /// Whether it was reset: behind the reply, all clients have to connect again.
    pub(super) restarts: bool,
    pub(super) assemblies: AssemblyData,
}

impl Device {
    pub(super) fn new(description: &'static Description, serial_number: u32, network: Network) -> Self {
        Self {
            description,
            serial_number,
            network,
            link: ReportedLink::default(),
            qos: Qos::default(),
            manager: ManagerCounters::default(),
            io: IoState::default(),
            locked: false,
            restarts: false,
            assemblies: AssemblyData::new(description),
        }
    }
}

/// A class of objects: what its instances have. The services that all classes share are in [`serve`].
trait Object {
    /// Class attribute 1.
    const REVISION: u16;
    /// Attributes of an instance.
    const ATTRIBUTES: &'static [u16];
    /// What Get_Attributes_All has, in its order. An attribute in it that the instance does not have is zero there.
    const ALL: &'static [u16] = Self::ATTRIBUTES;
    /// What the Get_Attributes_All of the class has, in its order. Attributes 1, 2, 3, 6 and 7 are there in any case.
    const CLASS_ATTRIBUTES: &'static [u16] = &[1, 2, 3];
    /// Whether the instances have Get_Attributes_All.
    const HAS_ALL: bool = true;
    /// Whether the instances have Set_Attribute_List. Of our classes the standard has it for the Connection Manager
    /// alone (volume 1, 3-5.4); the others take one attribute at a time.
    const SETS_LISTS: bool = false;

    /// Returns the highest instance number.
    fn max_instance(_device: &Device) -> u32 {
        1
    }

    /// Returns the number of instances.
    fn instances(_device: &Device) -> usize {
        1
    }

    /// Returns whether this instance exists.
    fn has(_device: &Device, instance: u32) -> bool {
        instance == 1
    }

    /// Returns whether the instances have an attribute now.
    fn has_attribute(_device: &Device, attribute: u16) -> bool {
        Self::ATTRIBUTES.contains(&attribute)
    }

    /// Writes an attribute of an instance that is there. Writes nothing where it fails.
    fn get(device: &Device, instance: u32, attribute: u16, writer: &mut Writer<'_>) -> Result<(), Violation>;

    /// Sets an attribute of an instance that is there, and that has it.
    fn set(_device: &mut Device, _instance: u32, _attribute: u16, _data: &[u8]) -> Result<(), Violation> {
        Err(Violation::NotSettable)
    }

    /// Returns the length of an attribute for Set_Attribute_List, which does not state it; `None` if there is no such
    /// attribute.
    fn listed_len(_attribute: u16) -> Option<usize> {
        None
    }

    /// Writes an attribute of the class.
    fn get_of_class(device: &Device, attribute: u16, writer: &mut Writer<'_>) -> Result<(), Violation> {
        let number = |number: usize| u16::try_from(number).unwrap_or(u16::MAX);
        match attribute {
            1 => writer.u16(Self::REVISION),
            2 => writer.u16(number(Self::max_instance(device) as usize)),
            3 => writer.u16(number(Self::instances(device))),
            6 => writer.u16(Self::CLASS_ATTRIBUTES.iter().copied().max().unwrap_or(0).max(7)),
            7 => {
                let present = Self::ATTRIBUTES.iter().copied().filter(|id| Self::has_attribute(device, *id));
                writer.u16(present.max().unwrap_or(0));
            }
            _ => return Err(Violation::UnknownAttribute),
        }
        Ok(())
    }

    /// Executes a service that only this class has.
    fn own_service(
        _device: &mut Device,
        _target: Target,
        _service: u8,
        _data: &[u8],
        _writer: &mut Writer<'_>,
    ) -> Result<General, Violation> {
        Err(Violation::UnknownService)
    }
}

/// Answers a request to any object but for the services of the Connection Manager.
pub(super) fn serve(
    device: &mut Device,
    target: Target,
    service: u8,
    data: &[u8],
    writer: &mut Writer<'_>,
) -> Result<General, Violation> {
    let code = target.class.ok_or(Violation::PathSegment)?;
    let class = ObjectClass::from_code(code).ok_or(Violation::UnknownObject)?;
    (class.served().serve)(device, target, service, data, writer)
}

/// Answers a request to an object of one class.
type Serve = fn(&mut Device, Target, u8, &[u8], &mut Writer<'_>) -> Result<General, Violation>;

/// How the device implements a class.
struct Served {
    revision: u16,
    serve: Serve,
}

impl Served {
    const fn by<O: Object>() -> Self {
        Self { revision: O::REVISION, serve: serve_class::<O> }
    }
}

impl ObjectClass {
    /// Returns the object that serves the class.
    const fn served(self) -> Served {
        match self {
            Self::Identity => Served::by::<identity::Identity>(),
            Self::MessageRouter => Served::by::<message_router::MessageRouter>(),
            Self::Assembly => Served::by::<assembly::Assembly>(),
            Self::ConnectionManager => Served::by::<connection_manager::ConnectionManager>(),
            Self::Qos => Served::by::<qos::QosObject>(),
            Self::Port => Served::by::<port::Port>(),
            Self::TcpIpInterface => Served::by::<tcp_ip::TcpIpInterface>(),
            Self::EthernetLink => Served::by::<ethernet_link::EthernetLink>(),
        }
    }

    /// Returns the revision of the class that the device implements: class attribute 1.
    #[must_use]
    pub const fn revision(self) -> u16 {
        self.served().revision
    }
}

fn serve_class<O: Object>(
    device: &mut Device,
    target: Target,
    service: u8,
    data: &[u8],
    writer: &mut Writer<'_>,
) -> Result<General, Violation> {
    let instance = target.instance.ok_or(Violation::UnknownObject)?;
    if instance != 0 && !O::has(device, instance) {
        return Err(Violation::UnknownInstance);
    }
    if target.member.is_some() {
        return Err(Violation::PathSegment);
    }
    let attribute = || {
        u16::try_from(target.attribute.ok_or(Violation::UnknownAttribute)?)
            .map_err(|_| Violation::UnknownAttribute)
    };
    match service {
        service::GET_ATTRIBUTES_ALL if instance == 0 => {
            O::CLASS_ATTRIBUTES.iter().try_for_each(|id| O::get_of_class(device, *id, writer))?;
            Ok(General::Success)
        }
        service::GET_ATTRIBUTES_ALL if O::HAS_ALL => {
            O::ALL.iter().try_for_each(|id| O::get(device, instance, *id, writer))?;
            Ok(General::Success)
        }
        service::GET_ATTRIBUTE_SINGLE => {
            get::<O>(device, instance, attribute()?, writer)?;
            Ok(General::Success)
        }
        service::GET_ATTRIBUTE_LIST => get_list::<O>(device, instance, data, writer),
        service::SET_ATTRIBUTE_SINGLE => {
            let attribute = attribute()?;
            if instance == 0 || !O::has_attribute(device, attribute) {
                let is_common = matches!(attribute, 1..=3 | 6 | 7);
                let known = instance == 0 && (is_common || O::CLASS_ATTRIBUTES.contains(&attribute));
                return Err(if known { Violation::NotSettable } else { Violation::UnknownAttribute });
            }
            O::set(device, instance, attribute, data)?;
            Ok(General::Success)
        }
        service::SET_ATTRIBUTE_LIST if instance != 0 && O::SETS_LISTS => {
            set_list::<O>(device, instance, data, writer)
        }
        service => O::own_service(device, target, service, data, writer),
    }
}

fn get<O: Object>(
    device: &Device,
    instance: u32,
    attribute: u16,
    writer: &mut Writer<'_>,
) -> Result<(), Violation> {
    if instance == 0 {
        O::get_of_class(device, attribute, writer)
    } else if O::has_attribute(device, attribute) {
        O::get(device, instance, attribute, writer)
    } else {
        Err(Violation::UnknownAttribute)
    }
}

/// Executes Get_Attribute_List: each attribute has a status of its own (volume 1, A-4.3).
fn get_list<O: Object>(
    device: &Device,
    instance: u32,
    data: &[u8],
    writer: &mut Writer<'_>,
) -> Result<General, Violation> {
    let mut reader = Reader::new(data);
    let count = reader.u16().map_err(|_| Violation::TooShort)?;
    let mut ids = reader.sub(2 * usize::from(count)).map_err(|_| Violation::TooShort)?;
    if !reader.is_empty() {
        return Err(Violation::TooLong);
    }
    let mut general = General::Success;
    writer.u16(count);
    while let Ok(id) = ids.u16() {
        writer.u16(id);
        let status_at = writer.len();
        writer.u16(0);
        if let Err(violation) = get::<O>(device, instance, id, writer) {
            writer.patch_u16(status_at, u8::from(violation.status().general).into());
            general = General::AttributeListError;
        }
    }
    Ok(general)
}

/// Executes Set_Attribute_List: each attribute has a status of its own (volume 1, A-4.4). After an attribute of unknown
/// length nothing more can be read: the reply ends with its status.
fn set_list<O: Object>(
    device: &mut Device,
    instance: u32,
    data: &[u8],
    writer: &mut Writer<'_>,
) -> Result<General, Violation> {
    let mut reader = Reader::new(data);
    let count = reader.u16().map_err(|_| Violation::TooShort)?;
    let (mut general, mut answered) = (General::Success, 0);
    let count_at = writer.len();
    writer.u16(0);
    while answered < count {
        let id = reader.u16().map_err(|_| Violation::TooShort)?;
        let len = O::listed_len(id);
        let set = match len {
            Some(len) => {
                let value = reader.bytes(len).map_err(|_| Violation::TooShort)?;
                O::set(device, instance, id, value)
            }
            None => Err(Violation::UnknownAttribute),
        };
        answered += 1;
        writer.u16(id);
        writer.u16(set.map_or_else(|violation| u8::from(violation.status().general).into(), |()| 0));
        if set.is_err() {
            general = General::AttributeListError;
        }
        if len.is_none() {
            writer.patch_u16(count_at, answered);
            return Ok(general);
        }
    }
    writer.patch_u16(count_at, answered);
    if reader.is_empty() { Ok(general) } else { Err(Violation::TooLong) }
}

/// Reads the single number that a settable attribute takes.
fn parse_exact<const N: usize>(data: &[u8]) -> Result<[u8; N], Violation> {
    data.try_into().map_err(|_| if data.len() > N { Violation::TooLong } else { Violation::TooShort })
}

/// Writes a SHORT_STRING: a length byte and so many characters.
fn write_short_string(writer: &mut Writer<'_>, text: &str) {
    let text = text.as_bytes();
    let len = text.len().min(usize::from(u8::MAX));
    writer.u8(len as u8);
    writer.bytes(text.get(..len).unwrap_or_default());
}

/// Writes the path of instance 1 of a class, with its length in words before it.
fn write_instance_path(writer: &mut Writer<'_>, class: u32) {
    writer.u16(2);
    writer.bytes(&[0x20, class as u8, 0x24, 1]);
}
