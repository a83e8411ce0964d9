//! The order in which the unknowns of a sparse symmetric matrix are eliminated so that there is little fill-in:
//! approximate minimum degree on a quotient graph.
//!
//! Source: Amestoy, Davis, Duff, "An approximate minimum degree ordering algorithm", SIAM J. Matrix Anal. Appl. 17
//! (1996).

use crate::interrupt;

const NONE: u32 = u32::MAX;

/// The order of elimination (n,) of a matrix whose row i has entries off its diagonal in the columns
/// `columns[first[i]..first[i + 1]]`.
pub(super) fn order(first: &[usize], columns: &[u32]) -> Vec<u32> {
    let n = first.len() - 1;
    let mut graph = Graph::new(first, columns);
    let (mut pivots, mut eliminated) = (Vec::new(), 0);
    while eliminated < n {
        interrupt::poll();
        let pivot = graph.buckets.take_least();
        pivots.push(pivot);
        eliminated += graph.weight[pivot as usize] as usize;
        graph.eliminate(pivot, n - eliminated);
    }
    graph.expand(&pivots)
}

/// The quotient graph. Remaining unknowns are nodes; a node stands also for the unknowns that were merged into it.
/// Eliminated unknowns are elements; an element connects all its nodes with each other.
struct Graph {
    /// Neighbours of each node that share no element with it   (n)
    nodes: Vec<Vec<u32>>,
    /// Elements that each node belongs to   (n)
    elements: Vec<Vec<u32>>,
    /// Nodes of each element; empty once the element is absorbed   (n)
    members: Vec<Vec<u32>>,
    /// How many unknowns each element connects   (n)
    size: Vec<u32>,
    is_alive: Vec<bool>,
    /// How many unknowns each node stands for: 0 once it is merged or eliminated   (n)
    weight: Vec<u32>,
    /// The node that each was merged into   (n)
    merged: Vec<u32>,
    buckets: Buckets,
    /// Stamp of the last visit to each node   (n)
    seen: Vec<u32>,
    stamp: u32,
    /// Number of unknowns of each element outside the newest one, and the stamp of that count   (n)
    outside: Vec<(u32, u32)>,
}

impl Graph {
    fn new(first: &[usize], columns: &[u32]) -> Self {
        let n = first.len() - 1;
        let nodes: Vec<Vec<u32>> = (0..n)
            .map(|i| columns[first[i]..first[i + 1]].to_vec())
            .collect();
        let mut buckets = Buckets::new(n);
        for (i, beside) in nodes.iter().enumerate() {
            buckets.insert(i as u32, beside.len() as u32);
        }
        Self {
            nodes,
            elements: vec![Vec::new(); n],
            members: vec![Vec::new(); n],
            size: vec![0; n],
            is_alive: vec![false; n],
            weight: vec![1; n],
            merged: vec![NONE; n],
            buckets,
            seen: vec![0; n],
            stamp: 0,
            outside: vec![(0, 0); n],
        }
    }

    /// Eliminate a node: it becomes an element; `left` unknowns remain.
    fn eliminate(&mut self, pivot: u32, left: usize) {
        let p = pivot as usize;
        let mut adjacent = self.neighbours(pivot);
        self.weight[p] = 0;
        let size: u32 = adjacent.iter().map(|&i| self.weight[i as usize]).sum();
        let stamp = self.stamp;
        for &i in &adjacent {
            for &e in &self.elements[i as usize] {
                let (outside, when) = &mut self.outside[e as usize];
                if *when != stamp {
                    (*outside, *when) = (self.size[e as usize], stamp);
                }
                if self.is_alive[e as usize] {
                    *outside -= self.weight[i as usize];
                }
            }
        }
        let mut alike: Vec<(u64, u32)> = Vec::with_capacity(adjacent.len());
        for &node in &adjacent {
            let i = node as usize;
            let (outside, is_alive, members) =
                (&self.outside, &mut self.is_alive, &mut self.members);
            self.elements[i].retain(|&e| {
                // An element without nodes outside the new one is absorbed by it.
                let stays = is_alive[e as usize] && outside[e as usize].0 > 0;
                if !stays {
                    is_alive[e as usize] = false;
                    members[e as usize] = Vec::new();
                }
                stays
            });
            let (weight, seen) = (&self.weight, &self.seen);
            self.nodes[i].retain(|&j| weight[j as usize] > 0 && seen[j as usize] != stamp);
            let others = size - weight[i];
            let apart = self.elements[i]
                .iter()
                .map(|&e| outside[e as usize].0)
                .sum::<u32>()
                + self.nodes[i]
                    .iter()
                    .map(|&j| weight[j as usize])
                    .sum::<u32>();
            let grown = self.buckets.degree[i].saturating_add(others);
            let degree = (left as u32 - weight[i]).min(grown).min(apart + others);
            self.buckets.remove(node);
            self.buckets.degree[i] = degree;
            self.elements[i].push(pivot);
            let sum = |all: &[u32]| all.iter().map(|&x| u64::from(x) + 1).sum::<u64>();
            alike.push((sum(&self.elements[i]) * 31 + sum(&self.nodes[i]), node));
        }
        self.merge(&mut alike);
        adjacent.retain(|&i| self.weight[i as usize] > 0);
        for &i in &adjacent {
            self.buckets.insert(i, self.buckets.degree[i as usize]);
        }
        self.members[p] = adjacent;
        self.size[p] = size;
        self.is_alive[p] = size > 0;
    }

    /// All nodes that are connected to a node, directly or by an element; its elements are absorbed.
    fn neighbours(&mut self, pivot: u32) -> Vec<u32> {
        self.stamp += 1;
        let (stamp, weight, seen) = (self.stamp, &self.weight, &mut self.seen);
        seen[pivot as usize] = stamp;
        let mut adjacent = Vec::new();
        let mut add_unseen = |nodes: Vec<u32>| {
            for j in nodes {
                if weight[j as usize] > 0 && seen[j as usize] != stamp {
                    seen[j as usize] = stamp;
                    adjacent.push(j);
                }
            }
        };
        add_unseen(std::mem::take(&mut self.nodes[pivot as usize]));
        for e in std::mem::take(&mut self.elements[pivot as usize]) {
            add_unseen(std::mem::take(&mut self.members[e as usize]));
            self.is_alive[e as usize] = false;
        }
        adjacent
    }

    /// Merge nodes that have the same neighbours and elements; `alike` holds a hash of these for each node.
    fn merge(&mut self, alike: &mut [(u64, u32)]) {
        alike.sort_unstable();
        for group in alike.chunk_by(|a, b| a.0 == b.0) {
            for (index, &(_, node)) in group.iter().enumerate() {
                let i = node as usize;
                if self.weight[i] == 0 {
                    continue;
                }
                for &(_, other) in &group[index + 1..] {
                    let j = other as usize;
                    let is_same = self.weight[j] > 0
                        && same(&mut self.elements, i, j)
                        && same(&mut self.nodes, i, j);
                    if !is_same {
                        continue;
                    }
                    self.buckets.degree[i] -= self.weight[j];
                    self.weight[i] += self.weight[j];
                    self.weight[j] = 0;
                    self.merged[j] = node;
                    self.nodes[j] = Vec::new();
                    self.elements[j] = Vec::new();
                }
            }
        }
    }

    /// The final order: each pivot, followed by the nodes that were merged into it.
    fn expand(&self, pivots: &[u32]) -> Vec<u32> {
        let n = self.merged.len();
        let mut parts: Vec<Vec<u32>> = vec![Vec::new(); n];
        for (i, &into) in self.merged.iter().enumerate() {
            if into != NONE {
                parts[into as usize].push(i as u32);
            }
        }
        let mut order = Vec::with_capacity(n);
        let mut waiting = Vec::new();
        for &pivot in pivots {
            waiting.push(pivot);
            while let Some(node) = waiting.pop() {
                order.push(node);
                waiting.extend(&parts[node as usize]);
            }
        }
        order
    }
}

/// Whether two lists hold the same numbers; sorts both.
fn same(lists: &mut [Vec<u32>], i: usize, j: usize) -> bool {
    if lists[i].len() != lists[j].len() {
        return false;
    }
    lists[i].sort_unstable();
    lists[j].sort_unstable();
    lists[i] == lists[j]
}

/// Nodes in doubly linked lists, one list for each degree.
struct Buckets {
    head: Vec<u32>,
    next: Vec<u32>,
    before: Vec<u32>,
    degree: Vec<u32>,
    least: usize,
}

impl Buckets {
    fn new(n: usize) -> Self {
        Self {
            head: vec![NONE; n.max(1)],
            next: vec![NONE; n],
            before: vec![NONE; n],
            degree: vec![0; n],
            least: 0,
        }
    }

    fn insert(&mut self, node: u32, degree: u32) {
        let (i, bucket) = (node as usize, degree as usize);
        self.degree[i] = degree;
        let after = self.head[bucket];
        (self.next[i], self.before[i]) = (after, NONE);
        if after != NONE {
            self.before[after as usize] = node;
        }
        self.head[bucket] = node;
        self.least = self.least.min(bucket);
    }

    fn remove(&mut self, node: u32) {
        let i = node as usize;
        let (before, after) = (self.before[i], self.next[i]);
        if before == NONE {
            self.head[self.degree[i] as usize] = after;
        } else {
            self.next[before as usize] = after;
        }
        if after != NONE {
            self.before[after as usize] = before;
        }
    }

    /// Remove and return a node of the least degree; there must be one.
    fn take_least(&mut self) -> u32 {
        while self.head[self.least] == NONE {
            self.least += 1;
        }
        let node = self.head[self.least];
        self.remove(node);
        node
    }
}
