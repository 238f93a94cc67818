#!/usr/bin/env python3
"""Reads a segment, written from the layout page (docs/segment.md) alone, with nothing but the standard library.

    segment_reader.py PATH              header, regions and the latest sample of each, as one JSON document
    segment_reader.py PATH REGION N     follows the next N samples of the region and prints how many it got and lost; of
                                        servo also where the motors are in the last of them
    segment_reader.py PATH REGION N --numbered
                                        for tests, whose writer puts one number into all words of a sample: how many were mixed

A plain 64-bit load from a memoryview is one processor load; in this order that is right on x86-64 (see the page).
"""

import json
import mmap
import os
import stat
import sys
import time

MAGIC = int.from_bytes(b"PMACDPRM", "little")
REGIONS = {1: "servo", 2: "background", 3: "board", 4: "panel", 5: "variables", 6: "gather", 7: "user",
           8: "user table"}
# Where in a motor's servo block its actual position is (pmacctl board map).
ACTUAL_POSITION = 4
# How long to wait for a sample, in seconds.
PATIENCE_S = 5


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
        if self.at(0x060) not in (1, 2):
            raise SystemExit(f"the times in {path} are of an unknown clock")
        self.check_hash()
        table, count, stride = self.at(0x0C0), self.at(0x0C8), self.at(0x0D0)
        self.regions = {}
        for entry in range(table, table + count * stride, stride):
            name = REGIONS.get(self.at(entry))
            if name:
                self.regions[name] = Region(self, entry)

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

    def is_fresh(self, region, sample):
        """Whether the sample may be shown as live; the page has the rules."""
        now = time.monotonic_ns() if self.at(0x060) == 1 else self.at(0x0A0)

        def is_old(time_ns, limit):
            # A time more than a second ahead of now is by another clock.
            return limit != 0 and not -(10**9) <= now - time_ns <= limit

        alive = self.at(0x040) == 1 and not is_old(self.at(0x080), self.at(0x070))
        age_limit = self.at(region.entry + 0x50)
        live = self.at(region.entry + 0x40) == 1 and not is_old(sample["time_ns"], age_limit)
        return alive and live and sample["valid"]

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
    def __init__(self, segment, entry):
        self.segment, self.entry = segment, entry
        fields = [segment.at(entry + offset) for offset in range(0x08, 0x38, 8)]
        self.head, self.slots, self.count, self.stride, self.payload, self.host_offset = fields
        # In 16-bit words: where the first number's block begins, and how long a block is.
        self.block_start, self.block_words = segment.at(entry + 0x68) // 2, segment.at(entry + 0x70) // 2
        self.block_count = segment.at(entry + 0x78)

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
        if self.block_count == 0:
            return True
        number, word = divmod(index - self.block_start, self.block_words)
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
            "blocks": [2 * self.block_start, 2 * self.block_words, self.block_count],
            "state": self.segment.at(self.entry + 0x40),
            "stale_after_ns": self.segment.at(self.entry + 0x50),
            "latest": self.latest(),
        }


def follow(region, wanted, numbered=False):
    """The samples from now on, each once. Gives up when none has come for a while."""
    got, lost, mixed, last = 0, 0, 0, None
    following = region.published() + 1
    deadline = time.monotonic() + PATIENCE_S
    while got + lost < wanted and time.monotonic() < deadline:
        sample = region.read(following)
        if sample is None:
            # Polling is the simple way; a program that has to be quick waits on the futex (see the page).
            time.sleep(0.0005)
            continue
        deadline = time.monotonic() + PATIENCE_S
        if sample is False:
            resume = max(region.published() - region.count // 2, following + 1)
            lost, following = lost + resume - following, resume
            continue
        mixed += numbered and len(set(sample["words"])) != 1
        got, following, last = got + 1, following + 1, sample
    counts = {"got": got, "lost": lost}
    return counts | {"mixed": mixed} if numbered else counts, last


def position_scales(board):
    """Ix08 of each motor that has told it, from the board region's latest sample (docs/segment.md)."""
    if not board:
        return {}
    payload = b"".join(word.to_bytes(2, sys.byteorder) for word in board["words"])
    known = int.from_bytes(payload[0x30:0x34], sys.byteorder)
    scales = enumerate(memoryview(payload[0x110:0x190]).cast("i").tolist(), 1)
    return {motor: scale for motor, scale in scales if known >> motor - 1 & 1 and scale > 0}


def actual_positions(region, sample, scales):
    """Where each motor is: in counts if its scale is known, else the 48-bit number as the board has it."""
    motors = {}
    for motor in range(1, region.block_count + 1):
        at = region.block_start + (motor - 1) * region.block_words
        if at + region.block_words > len(sample["words"]):
            break
        words = sample["words"][at + ACTUAL_POSITION : at + ACTUAL_POSITION + 4]
        if None in words:
            continue
        # Two 24-bit halves, each in 32 bits, the low one (Y) first.
        low, high = (words[0] | words[1] << 16) & 0xFFFFFF, (words[2] | words[3] << 16) & 0xFFFFFF
        raw = (high << 24 | low) - ((high >> 23) << 48)
        motors[motor] = raw / (scales[motor] * 32) if motor in scales else {"raw": raw}
    return motors


def main():
    segment = Segment(sys.argv[1])
    if len(sys.argv) > 3:
        region = segment.regions[sys.argv[2]]
        followed, last = follow(region, int(sys.argv[3]), "--numbered" in sys.argv[4:])
        if last and sys.argv[2] == "servo" and "mixed" not in followed:
            scales = position_scales(segment.regions["board"].latest()) if "board" in segment.regions else {}
            followed["servo_timer"] = last["servo_timer"]
            followed["fresh"] = segment.is_fresh(region, last)
            followed["actual_positions"] = actual_positions(region, last, scales)
        print(json.dumps(followed))
        return
    regions = {name: region.info() for name, region in segment.regions.items()}
    print(json.dumps({"header": segment.header(), "regions": regions}))


if __name__ == "__main__":
    main()
