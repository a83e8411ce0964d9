//! Names of modules: a generator's members share one, `string` → `string.12`.

/// A stretch of modules under one name.
#[derive(Clone, Debug)]
struct Group {
    first: usize,
    len: usize,
    /// Numbered members are shown with their index.
    numbered: bool,
    name: String,
    /// Which member is the middle one.
    centre: usize,
}

/// The names of a network's MATs and LIAs.
#[derive(Clone, Debug, Default)]
pub(super) struct Names {
    mats: Vec<Group>,
    links: Vec<Group>,
}

fn find(groups: &[Group], index: usize) -> Option<&Group> {
    let at = groups.partition_point(|group| group.first + group.len <= index);
    groups.get(at).filter(|group| group.first <= index)
}

fn show(groups: &[Group], index: usize) -> String {
    match find(groups, index) {
        Some(group) if group.numbered => format!("{}.{}", group.name, index - group.first),
        Some(group) => group.name.clone(),
        None => format!("#{index}"),
    }
}

impl Names {
    pub(super) fn add_mats(
        &mut self,
        first: usize,
        len: usize,
        numbered: bool,
        name: String,
        centre: usize,
    ) {
        self.mats.push(Group {
            first,
            len,
            numbered,
            name,
            centre,
        });
    }

    pub(super) fn add_links(&mut self, first: usize, len: usize, numbered: bool, name: String) {
        self.links.push(Group {
            first,
            len,
            numbered,
            name,
            centre: 0,
        });
    }

    pub(super) fn mat(&self, index: usize) -> String {
        show(&self.mats, index)
    }

    pub(super) fn link(&self, index: usize) -> String {
        show(&self.links, index)
    }

    /// How many MATs the module that begins at `first` has.
    pub(super) fn count(&self, first: usize) -> usize {
        find(&self.mats, first).map_or(0, |group| group.len - (first - group.first))
    }

    /// The middle MAT of the module that begins at `first`.
    pub(super) fn centre(&self, first: usize) -> usize {
        find(&self.mats, first).map_or(first, |group| group.first + group.centre)
    }
}
