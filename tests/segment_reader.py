#!/usr/bin/env python3
"""Reads a segment, written from the layout page (src/segment/layout.rs) alone, with nothing but the standard library.

    segment_reader.py PATH              header, regions and the latest sample of each, as one JSON document
    segment_reader.py PATH REGION N     follows N samples of the region and prints how many it got and lost

A plain 64-bit load from a memoryview is one processor load; in this order that is right on x86-64 (see the page).
"""

import json
import mmap
import os
import stat
import sys
import time

MAGIC = int.from_bytes(b"PMACDPRM", "little")
REGIONS = {1: "servo", 2: "background", 3: "board", 4: "panel", 5: "variable", 6: "gather"}
# Where the first number's block begins (host byte offset), and words (16 bits) of a block.
BLOCKS = {"servo": (0x48, 30), "background": (0x24C, 62)}


class Segment:
    def __init__(self, path):
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
        there = os.fstat(descriptor)
        if not stat.S_ISREG(there.st_mode) or there.st_uid not in (0, os.geteuid()) or there.st_size < 0x300:
            raise SystemExit(f"{path} is not a segment to be trusted")
        header = os.pread(descriptor, 0x30, 0)
        if int.from_bytes(header[0x28:0x30], sys.byteorder) != there.st_size:
            raise SystemExit(f"{path} is not as long as its header says")
        self.map = mmap.mmap(descriptor, there.st_size, mmap.MAP_SHARED, mmap.PROT_READ)
        os.close(descriptor)
        self.words = memoryview(self.map).cast("Q")
        if self.at(0x000) != MAGIC or self.at(0x008) != 1 or self.at(0x030) != 0x0102030405060708:
            raise SystemExit(f"{path} is not a segment of version 1")
        self.check_hash()
        table, count, stride = self.at(0x0C0), self.at(0x0C8), self.at(0x0D0)
        self.regions = {}
        for entry in range(table, table + count * stride, stride):
            name = REGIONS.get(self.at(entry))
            if name:
                self.regions[name] = Region(self, entry, BLOCKS.get(name))

    def at(self, offset):
        return self.words[offset // 8]

    def check_hash(self):
        offsets = [0x008, 0x018, 0x028, 0x0C0, 0x0C8, 0x0D0, 0x0D8]
        for index in range(self.at(0x0C8)):
            entry = self.at(0x0C0) + index * self.at(0x0D0)
            offsets += [entry + 8 * word for word in range(8)]
        value = 0xCBF29CE484222325
        for offset in offsets:
            for byte in self.at(offset).to_bytes(8, "little"):
                value = (value ^ byte) * 0x100000001B3 % 2**64
        if value != self.at(0x020):
            raise SystemExit("the segment's geometry does not match its checksum")

    def header(self):
        count = self.at(0x0E0)
        return {
            "state": self.at(0x040),
            "generation": self.at(0x048),
            "owner_pid": self.at(0x050),
            "beats": self.at(0x088),
            "counters": [self.at(self.at(0x0D8) + 8 * index) for index in range(count)],
        }


class Region:
    def __init__(self, segment, entry, blocks):
        self.segment, self.entry, self.blocks = segment, entry, blocks
        fields = [segment.at(entry + offset) for offset in range(0x08, 0x38, 8)]
        self.head, self.slots, self.count, self.stride, self.payload, self.host_offset = fields

    def published(self):
        return self.segment.at(self.head)

    def read(self, number):
        """Sample `number`, None if it is not published yet, False if it was overwritten."""
        at = self.segment.at
        head = self.published()
        if number > head:
            return None
        slot = self.slots + (number - 1) % self.count * self.stride
        if head - number >= self.count or at(slot) != 2 * number:
            return False
        first = slot // 8
        body = self.segment.words[first + 1 : first + 4 + (self.payload + 7) // 8].tolist()
        if at(slot) != 2 * number:
            return False
        payload = b"".join(word.to_bytes(8, sys.byteorder) for word in body[3:])
        length = body[2] >> 32
        if length > self.payload:
            raise SystemExit(f"sample {number} is corrupt")
        halves = memoryview(payload[: length // 2 * 2]).cast("H").tolist()
        return {
            "sequence": number,
            "time_ns": body[0],
            "servo_timer": body[1],
            "valid": bool(body[2] & 1),
            "length": length,
            "words": [word if self.is_read(index) else None for index, word in enumerate(halves)],
        }

    def is_read(self, index):
        """Whether the word is read from the board at all: one that is not is 0 and means nothing."""
        if self.blocks is None:
            return True
        start, length = self.blocks
        number, word = divmod(index - (start - self.host_offset) // 2, length)
        unread_words, unread_numbers = self.segment.at(self.entry + 0x58), self.segment.at(self.entry + 0x60)
        return number < 0 or not (unread_words >> word & 1 or unread_numbers >> number & 1)

    def latest(self):
        for _ in range(1000):
            head = self.published()
            if head == 0:
                return None
            sample = self.read(head)
            if sample:
                return sample
        raise SystemExit("overtaken a thousand times")

    def info(self):
        return {
            "slots": self.count,
            "payload_bytes": self.payload,
            "first_host_offset": self.host_offset,
            "state": self.segment.at(self.entry + 0x40),
            "stale_after_ns": self.segment.at(self.entry + 0x50),
            "latest": self.latest(),
        }


def follow(region, wanted):
    got, lost, following, mixed = 0, 0, 1, 0
    deadline = time.monotonic() + 20
    while got + lost < wanted and time.monotonic() < deadline:
        sample = region.read(following)
        if sample is None:
            continue
        if sample is False:
            resume = max(region.published() - region.count // 2, following + 1)
            lost, following = lost + resume - following, resume
            continue
        mixed += len(set(sample["words"])) != 1
        got, following = got + 1, following + 1
    return {"got": got, "lost": lost, "mixed": mixed}


def main():
    segment = Segment(sys.argv[1])
    if len(sys.argv) > 3:
        print(json.dumps(follow(segment.regions[sys.argv[2]], int(sys.argv[3]))))
        return
    regions = {name: region.info() for name, region in segment.regions.items()}
    print(json.dumps({"header": segment.header(), "regions": regions}))


if __name__ == "__main__":
    main()
