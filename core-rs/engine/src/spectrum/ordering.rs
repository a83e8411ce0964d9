//! The order in which the unknowns of a sparse symmetric matrix are eliminated so that there is little fill-in:
//! approximate minimum degree on a quotient graph.
//!
//! Source: Amestoy, Davis, Duff, "An approximate minimum degree ordering algorithm", SIAM J. Matrix Anal. Appl. 17
//! (1996).

use crate::interrupt;

/// The order of elimination (n,) of a matrix whose row i has entries off its diagonal in the columns
/// `columns[first[i]..first[i + 1]]`.
pub(super) fn order(first: &[usize], columns: &[u32]) -> Vec<u32> {
    let node_count = first.len() - 1;
    let mut graph = Graph::new(first, columns);
    let (mut pivots, mut eliminated) = (Vec::new(), 0);
    while eliminated < node_count {
        interrupt::poll();
        let pivot = graph.buckets.take_least();
        pivots.push(pivot);
        eliminated += graph.weight[pivot as usize] as usize;
        graph.eliminate(pivot, node_count - eliminated);
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
    merged: Vec<Option<u32>>,
    buckets: Buckets,
    /// Stamp of the last visit to each node   (n)
    seen: Vec<u32>,
    stamp: u32,
    /// Number of unknowns of each element outside the newest one, and the stamp of that count   (n)
    outside: Vec<(u32, u32)>,
}

impl Graph {
    fn new(first: &[usize], columns: &[u32]) -> Self {
        let node_count = first.len() - 1;
        let nodes: Vec<Vec<u32>> = (0..node_count)
            .map(|i| columns[first[i]..first[i + 1]].to_vec())
            .collect();
        let mut buckets = Buckets::new(node_count);
        for (i, neighbours) in nodes.iter().enumerate() {
            buckets.insert(i as u32, neighbours.len() as u32);
        }
        Self {
            nodes,
            elements: vec![Vec::new(); node_count],
            members: vec![Vec::new(); node_count],
            size: vec![0; node_count],
            is_alive: vec![false; node_count],
            weight: vec![1; node_count],
            merged: vec![None; node_count],
            buckets,
            seen: vec![0; node_count],
            stamp: 0,
            outside: vec![(0, 0); node_count],
        }
    }

    /// Eliminate a node: it becomes an element; `unknowns_left` unknowns remain.
    fn eliminate(&mut self, pivot: u32, unknowns_left: usize) {
        let pivot_index = pivot as usize;
        let mut adjacent = self.neighbours(pivot);
        self.weight[pivot_index] = 0;
        let adjacent_weight: u32 = adjacent.iter().map(|&node| self.weight[node as usize]).sum();
        let stamp = self.stamp;
        for &node in &adjacent {
            for &element in &self.elements[node as usize] {
                let (outside, last_stamp) = &mut self.outside[element as usize];
                if *last_stamp != stamp {
                    (*outside, *last_stamp) = (self.size[element as usize], stamp);
                }
                if self.is_alive[element as usize] {
                    *outside -= self.weight[node as usize];
                }
            }
        }
        let mut hashed_nodes: Vec<(u64, u32)> = Vec::with_capacity(adjacent.len());
        for &node in &adjacent {
            let node_index = node as usize;
            let (outside, is_alive, members) = (&self.outside, &mut self.is_alive, &mut self.members);
            self.elements[node_index].retain(|&element| {
                // An element without nodes outside the new one is absorbed by it.
                let is_retained = is_alive[element as usize] && outside[element as usize].0 > 0;
                if !is_retained {
                    is_alive[element as usize] = false;
                    members[element as usize] = Vec::new();
                }
                is_retained
            });
            let (weights, stamps) = (&self.weight, &self.seen);
            self.nodes[node_index].retain(|&j| weights[j as usize] > 0 && stamps[j as usize] != stamp);
            let other_weight = adjacent_weight - weights[node_index];
            let apart_weight = self.elements[node_index]
                .iter()
                .map(|&element| outside[element as usize].0)
                .sum::<u32>()
                + self.nodes[node_index].iter().map(|&j| weights[j as usize]).sum::<u32>();
            let degree_bound = self.buckets.degree[node_index].saturating_add(other_weight);
            let new_degree = (unknowns_left as u32 - weights[node_index])
                .min(degree_bound)
                .min(apart_weight + other_weight);
            self.buckets.remove(node);
            self.buckets.degree[node_index] = new_degree;
            self.elements[node_index].push(pivot);
            let list_hash = |all: &[u32]| all.iter().map(|&x| u64::from(x) + 1).sum::<u64>();
            hashed_nodes.push((
                list_hash(&self.elements[node_index]) * 31 + list_hash(&self.nodes[node_index]),
                node,
            ));
        }
        self.merge(&mut hashed_nodes);
        adjacent.retain(|&node| self.weight[node as usize] > 0);
        for &node in &adjacent {
            self.buckets.insert(node, self.buckets.degree[node as usize]);
        }
        self.members[pivot_index] = adjacent;
        self.size[pivot_index] = adjacent_weight;
        self.is_alive[pivot_index] = adjacent_weight > 0;
    }

    /// All nodes that are connected to a node, directly or by an element; its elements are absorbed.
    fn neighbours(&mut self, pivot: u32) -> Vec<u32> {
        self.stamp += 1;
        let (current_stamp, weights, stamps) = (self.stamp, &self.weight, &mut self.seen);
        stamps[pivot as usize] = current_stamp;
        let mut adjacent = Vec::new();
        let mut add_unseen = |nodes: Vec<u32>| {
            for j in nodes {
                if weights[j as usize] > 0 && stamps[j as usize] != current_stamp {
                    stamps[j as usize] = current_stamp;
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

    /// Merge nodes that have the same neighbours and elements; `hashed_nodes` holds a hash of these for each
    /// node.
    fn merge(&mut self, hashed_nodes: &mut [(u64, u32)]) {
        hashed_nodes.sort_unstable();
        for group in hashed_nodes.chunk_by(|a, b| a.0 == b.0) {
            for (index, &(_, node)) in group.iter().enumerate() {
                let node_index = node as usize;
                if self.weight[node_index] == 0 {
                    continue;
                }
                for &(_, other) in &group[index + 1..] {
                    let other_index = other as usize;
                    let is_alike = self.weight[other_index] > 0
                        && same(&mut self.elements, node_index, other_index)
                        && same(&mut self.nodes, node_index, other_index);
                    if !is_alike {
                        continue;
                    }
                    self.buckets.degree[node_index] -= self.weight[other_index];
                    self.weight[node_index] += self.weight[other_index];
                    self.weight[other_index] = 0;
                    self.merged[other_index] = Some(node);
                    self.nodes[other_index] = Vec::new();
                    self.elements[other_index] = Vec::new();
                }
            }
        }
    }

    /// The final order: each pivot, followed by the nodes that were merged into it.
    fn expand(&self, pivots: &[u32]) -> Vec<u32> {
        let node_count = self.merged.len();
        let mut merged_nodes: Vec<Vec<u32>> = vec![Vec::new(); node_count];
        for (i, &into) in self.merged.iter().enumerate() {
            if let Some(into) = into {
                merged_nodes[into as usize].push(i as u32);
            }
        }
        let mut full_order = Vec::with_capacity(node_count);
        let mut waiting = Vec::new();
        for &pivot in pivots {
            waiting.push(pivot);
            while let Some(node) = waiting.pop() {
                full_order.push(node);
                waiting.extend(&merged_nodes[node as usize]);
            }
        }
        full_order
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
    head: Vec<Option<u32>>,
    next: Vec<Option<u32>>,
    before: Vec<Option<u32>>,
    degree: Vec<u32>,
    least: usize,
}

impl Buckets {
    fn new(n: usize) -> Self {
        Self {
            head: vec![None; n.max(1)],
            next: vec![None; n],
            before: vec![None; n],
            degree: vec![0; n],
            least: 0,
        }
    }

    fn insert(&mut self, node: u32, degree: u32) {
        let (node_index, bucket) = (node as usize, degree as usize);
        self.degree[node_index] = degree;
        let next_node = self.head[bucket];
        (self.next[node_index], self.before[node_index]) = (next_node, None);
        if let Some(next_node) = next_node {
            self.before[next_node as usize] = Some(node);
        }
        self.head[bucket] = Some(node);
        self.least = self.least.min(bucket);
    }

    fn remove(&mut self, node: u32) {
        let node_index = node as usize;
        let (previous_node, next_node) = (self.before[node_index], self.next[node_index]);
        match previous_node {
            None => self.head[self.degree[node_index] as usize] = next_node,
            Some(previous_node) => self.next[previous_node as usize] = next_node,
        }
        if let Some(next_node) = next_node {
            self.before[next_node as usize] = previous_node;
        }
    }

    /// Remove and return a node of the least degree; there must be one.
    fn take_least(&mut self) -> u32 {
        loop {
            if let Some(least_node) = self.head[self.least] {
                self.remove(least_node);
                return least_node;
            }
            self.least += 1;
        }
    }
}
