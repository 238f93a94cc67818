//! iceoryx2: what it does where we do the same, through its own interface, with a payload of the same size.

use std::hint::black_box;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;

use crate::clock::{self, Figures, Series};
use crate::process::{Child, Shared, bind};

/// 520 bytes: 516 rounded up to whole words of 64 bit.
type Words = [u64; 65];

/// What the blackboard holds under its only key.
#[derive(Clone, Copy, Debug, ZeroCopySend)]
#[repr(C)]
struct Entry(Words);

fn node() -> Node<ipc::Service> {
    set_log_level(LogLevel::Error);
    NodeBuilder::new().create::<ipc::Service>().expect("a node")
}

/// A name that no other run of this program uses.
fn service(what: &str) -> ServiceName {
    format!("pmac-bench/{}/{what}", nix::unistd::getpgrp()).as_str().try_into().expect("a name")
}

/// One end of a data stream of `buffer` samples that overwrites its oldest.
macro_rules! stream {
    ($node:expr, $name:expr) => {
        $node
            .service_builder(&service($name))
            .publish_subscribe::<Words>()
            .max_publishers(2)
            .max_subscribers(4)
            .history_size(0)
            .subscriber_max_buffer_size(2)
            .enable_safe_overflow(true)
            .open_or_create()
            .expect("a service")
    };
}

macro_rules! event {
    ($node:expr, $name:expr) => {
        $node
            .service_builder(&service($name))
            .event()
            .max_listeners(8)
            .max_nodes(12)
            .open_or_create()
            .expect("a service")
    };
}

fn send(publisher: &Publisher<ipc::Service, Words, ()>, words: Words) {
    let sample = publisher.loan_uninit().expect("a sample").write_payload(words);
    sample.send().expect("sent");
}

fn take(subscriber: &Subscriber<ipc::Service, Words, ()>) -> Words {
    loop {
        if let Some(sample) = subscriber.receive().expect("received") {
            return *sample;
        }
    }
}

/// Ns of a round trip, median.
pub fn ping_pong(trips: u64) -> f64 {
    let shared = Shared::cells(2);
    let other = Child::on(0, || {
        let node = node();
        let (there, back) = (stream!(node, "there"), stream!(node, "back"));
        let subscriber = there.subscriber_builder().create().expect("a subscriber");
        let publisher = back.publisher_builder().create().expect("a publisher");
        shared.set(0, 1);
        shared.wait(1, 1);
        for _ in 0..trips {
            send(&publisher, take(&subscriber));
        }
        shared.wait(1, 2);
    });
    bind(1);
    shared.wait(0, 1);
    let node = node();
    let (there, back) = (stream!(node, "there"), stream!(node, "back"));
    let publisher = there.publisher_builder().create().expect("a publisher");
    let subscriber = back.subscriber_builder().create().expect("a subscriber");
    shared.set(1, 1);
    let mut words = [0; 65];
    let series: Series = (1..=trips)
        .map(|trip| {
            words[0] = trip;
            clock::time(|| {
                send(&publisher, words);
                black_box(take(&subscriber));
            })
        })
        .collect();
    shared.set(1, 2);
    other.join();
    series.figures().median
}

/// As [`super::fresh::first_reads`], of the blackboard.
pub fn blackboard_first_reads(period_ns: f64) -> Figures {
    let shared = Shared::cells(2);
    let writer = Child::on(0, || {
        let node = node();
        let board = node.service_builder(&service("board")).blackboard_creator::<u64>();
        let board = board.add::<Entry>(1, Entry([0; 65])).create().expect("a blackboard");
        let writer = board.writer_builder().create().expect("a writer");
        let entry = writer.entry::<Entry>(&1).expect("the entry");
        shared.set(0, 1);
        let period = clock::ticks(period_ns);
        let (mut number, mut next) = (0, clock::before());
        while shared.value(1) == 0 {
            number += 1;
            entry.update_with_copy(Entry([number; 65]));
            if period > 0 {
                next += period;
                clock::spin_until(next);
            }
        }
    });
    bind(1);
    shared.wait(0, 1);
    let node = node();
    let board = node.service_builder(&service("board")).blackboard_opener::<u64>().open().expect("opened");
    let reader = board.reader_builder().create().expect("a reader");
    let entry = reader.entry::<Entry>(&1).expect("the entry");
    let (mut first, mut last) = (Series::default(), 0);
    let end = clock::before() + clock::ticks(4e8);
    while clock::before() < end {
        for _ in 0..64 {
            let start = clock::before();
            let value = black_box(entry.get());
            let ticks = clock::between(start, clock::after());
            if value.0[0] != last {
                last = value.0[0];
                first.push(ticks);
            }
            assert!(value.0.iter().all(|word| *word == value.0[0]), "a mixed entry");
        }
    }
    shared.set(1, 1);
    writer.join();
    first.figures()
}

/// Ns of a read with a second reader and alone.
pub fn blackboard_two_readers() -> [f64; 2] {
    let shared = Shared::cells(2);
    let second = Child::on(0, || {
        let node = node();
        let board = node.service_builder(&service("two")).blackboard_creator::<u64>();
        let board = board.add::<Entry>(1, Entry([0; 65])).create().expect("a blackboard");
        let reader = board.reader_builder().create().expect("a reader");
        let entry = reader.entry::<Entry>(&1).expect("the entry");
        shared.set(0, 1);
        loop {
            match shared.value(1) {
                0 => std::thread::yield_now(),
                1 => {
                    black_box(entry.get());
                }
                _ => break,
            }
        }
    });
    bind(1);
    shared.wait(0, 1);
    let node = node();
    let board = node.service_builder(&service("two")).blackboard_opener::<u64>().open().expect("opened");
    let reader = board.reader_builder().create().expect("a reader");
    let entry = reader.entry::<Entry>(&1).expect("the entry");
    let figure = |readers: u64| {
        shared.set(1, readers - 1);
        let [ns] = clock::batches([&mut || {
            black_box(entry.get());
        }]);
        ns
    };
    let [one, two] = [figure(1), figure(2)];
    shared.set(1, 2);
    drop((entry, reader, board, node));
    second.join();
    [two, one]
}

/// The waking end of an event with data.
pub struct Waker {
    publisher: Publisher<ipc::Service, Words, ()>,
    notifier: Notifier<ipc::Service>,
    _node: Node<ipc::Service>,
}

impl Waker {
    pub fn new() -> Self {
        let node = node();
        let publisher = stream!(node, "wake").publisher_builder().create().expect("a publisher");
        let notifier = event!(node, "event").notifier_builder().create().expect("a notifier");
        Self { publisher, notifier, _node: node }
    }

    pub fn wake(&self, first: u64) {
        let mut words = [0; 65];
        words[0] = first;
        send(&self.publisher, words);
        self.notifier.notify().expect("notified");
    }

    /// Tells the waiters without data.
    pub fn nudge(&self) {
        self.notifier.notify().expect("notified");
    }
}

/// The sleeping end.
pub struct Sleeper {
    subscriber: Subscriber<ipc::Service, Words, ()>,
    listener: Listener<ipc::Service>,
    _node: Node<ipc::Service>,
}

impl Sleeper {
    pub fn new() -> Self {
        let node = node();
        let subscriber = stream!(node, "wake").subscriber_builder().create().expect("a subscriber");
        let listener = event!(node, "event").listener_builder().create().expect("a listener");
        Self { subscriber, listener, _node: node }
    }

    /// Sleeps until told, and copies out what came: its first word, and when the whole of it was here.
    pub fn sleep(&self, mut each: impl FnMut(u64, u64)) {
        self.listener.blocking_wait(|_| {}).expect("woken");
        while let Some(sample) = self.subscriber.receive().expect("received") {
            let words = black_box(*sample);
            each(words[0], clock::after());
        }
    }
}
