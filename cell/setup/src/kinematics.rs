//! The section `[robot.kinematics]` as it stands in a file: `kind`, and beside it the keys of this kind.
//!
//! serde would read it from a copy without keys and lines. This reader takes it key by key, so that an error names both, as
//! in every other section.

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize;
use serde::de::{Deserializer, Error, IgnoredAny, MapAccess, Visitor};

use crate::{Kinematics, Opw, Scara, Sourced, ThreeParallel};

/// Which geometry.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Kind {
    Scara,
    Opw,
    ThreeParallel,
}

impl Kind {
    const ALL: [Self; 3] = [Self::Scara, Self::Opw, Self::ThreeParallel];

    /// Returns the keys beside `kind`.
    const fn keys(self) -> &'static [&'static str] {
        match self {
            Self::Scara => &["link_1_mm", "link_2_mm", "height_mm"],
            Self::Opw => {
                &["a1_mm", "a2_mm", "b_mm", "c1_mm", "c2_mm", "c3_mm", "c4_mm", "offsets_deg", "signs"]
            }
            Self::ThreeParallel => {
                &["d1_mm", "a2_mm", "a3_mm", "d4_mm", "d5_mm", "d6_mm", "offsets_deg", "signs"]
            }
        }
    }
}

/// The section as it was read.
#[derive(Default)]
struct KinematicsSection {
    kind: Option<Kind>,
    numbers: BTreeMap<String, Sourced<f64>>,
    offsets_deg: Option<Sourced<[f64; 6]>>,
    signs: Option<Sourced<[i8; 6]>>,
    /// All keys but `kind`, in the order of the file.
    keys: Vec<String>,
}

impl<'de> Deserialize<'de> for Kinematics {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(SectionVisitor)?.resolve()
    }
}

struct SectionVisitor;

impl<'de> Visitor<'de> for SectionVisitor {
    type Value = KinematicsSection;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a table with the key `kind`")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut table: A) -> Result<KinematicsSection, A::Error> {
        let mut section = KinematicsSection::default();
        while let Some(key) = table.next_key::<String>()? {
            match key.as_str() {
                "kind" => {
                    section.kind = Some(table.next_value()?);
                    continue;
                }
                "offsets_deg" => section.offsets_deg = Some(table.next_value()?),
                "signs" => section.signs = Some(table.next_value()?),
                name if Kind::ALL.iter().any(|kind| kind.keys().contains(&name)) => {
                    section.numbers.insert(key.clone(), table.next_value()?);
                }
                _ => drop(table.next_value::<IgnoredAny>()?),
            }
            section.keys.push(key);
        }
        Ok(section)
    }
}

impl KinematicsSection {
    fn resolve<E: Error>(mut self) -> Result<Kinematics, E> {
        let kind = self.kind.ok_or_else(|| E::missing_field("kind"))?;
        if let Some(other) = self.keys.iter().find(|key| !kind.keys().contains(&key.as_str())) {
            return Err(E::unknown_field(other, kind.keys()));
        }
        Ok(match kind {
            Kind::Scara => Kinematics::Scara(Scara {
                link_1_mm: self.number("link_1_mm")?,
                link_2_mm: self.number("link_2_mm")?,
                height_mm: self.number("height_mm")?,
            }),
            Kind::Opw => Kinematics::Opw(Box::new(Opw {
                a1_mm: self.number("a1_mm")?,
                a2_mm: self.number("a2_mm")?,
                b_mm: self.number("b_mm")?,
                c1_mm: self.number("c1_mm")?,
                c2_mm: self.number("c2_mm")?,
                c3_mm: self.number("c3_mm")?,
                c4_mm: self.number("c4_mm")?,
                offsets_deg: required(self.offsets_deg, "offsets_deg")?,
                signs: required(self.signs, "signs")?,
            })),
            Kind::ThreeParallel => Kinematics::ThreeParallel(Box::new(ThreeParallel {
                d1_mm: self.number("d1_mm")?,
                a2_mm: self.number("a2_mm")?,
                a3_mm: self.number("a3_mm")?,
                d4_mm: self.number("d4_mm")?,
                d5_mm: self.number("d5_mm")?,
                d6_mm: self.number("d6_mm")?,
                offsets_deg: required(self.offsets_deg, "offsets_deg")?,
                signs: required(self.signs, "signs")?,
            })),
        })
    }

    fn number<E: Error>(&mut self, key: &'static str) -> Result<Sourced<f64>, E> {
        required(self.numbers.remove(key), key)
    }
}

fn required<T, E: Error>(value: Option<T>, key: &'static str) -> Result<T, E> {
    value.ok_or_else(|| E::missing_field(key))
}
