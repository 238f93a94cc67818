/* Background variable write. The control panel's requests go by the same handshake. The host writes what is
 * to be done (two words here: a record's address and data; the request words of two motors), then the count (0x07D4) or
 * enable mask (0x0000). PMAC does it, and writes 0 to say so.
 *
 * Pmac mirrors src/sim/variable_write.rs (src/sim/panel.rs), word by word; Host src/function/variable_write.rs and
 * src/daemon/bus/work/write.rs (src/function/panel.rs and src/daemon/bus/work/panel.rs). Every access to the DPRAM is one step;
 * so is the deed itself. Jobs are numbered, and both words of a job carry its number.
 *
 * What holds: a job told to be done was done exactly once and as asked; a job given up was done once or not at all.
 *
 * The rest after a job taken back (SETTLE) is in variable_write.rs; the panel's desk, and both at their start, do not keep
 * it yet.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * CRASH       the host is killed anywhere, any number of times, and started again
 * NO_REST     after a job was given up the next one does not wait until a pass under way has ended. FAILS: PMAC has seen
 *             the count; the host, at its deadline, takes it back, and writes the next job over it, with its count; PMAC
 *             does half of the one and half of the other and writes 0, which the host takes for the next job done.
 * NO_START_REST the new host does not wait so either. FAILS with CRASH: the same, across a restart.
 * RESET       the board is reset anywhere, once, and clears the count. FAILS: the host takes it for done. From the word
 *             alone nobody could tell; the host learns of a reset from the servo timer, too late for this.
 * NO_RELEASE  the host does not clear the count at its start. FAILS with CRASH: a job nobody waits for is done after all.
 */
#define JOBS 4

byte count;
byte word[2];

byte done[JOBS];                                      /* how often; 2 is too often */
byte job = 0;                                         /* the one that the host is at */
bool begun = true;                                    /* the present host has begun a job, or is not ready yet */
bool in_pass = false;
bool killed = false, resetting = false;

proctype Pmac() {
  byte a, b;
  do
  :: {
    do
    :: atomic { count != 0 -> in_pass = true; assert(begun) };                /* one background pass */
       a = word[0];
       atomic {
         b = word[1];
         assert(a == b);                              /* never half of one and half of another */
         assert(done[a] == 0);
         done[a]++;
         a = 0; b = 0
       };
       atomic { count = 0; in_pass = false }
    od
  } unless { atomic { resetting -> resetting = false; in_pass = false; count = 0; a = 0; b = 0 } }
  od
}

proctype Host() {
  do
  :: {
#ifndef NO_RELEASE
    count = 0;                                        /* VariableWriter::release, Panel::withdraw */
#endif
#ifndef NO_START_REST
    !in_pass;                                         /* SETTLE */
#endif
    begun = false;
    do
    :: atomic { count == 0 -> job = (job + 1) % JOBS; done[job] = 0; begun = true };
       word[0] = job;
       word[1] = job;
       count = 1;
       if
       :: atomic { count == 0 -> assert(done[job] == 1) }                 /* told: done */
       :: count = 0;                                                      /* told: given up, perhaps done */
#ifndef NO_REST
          !in_pass                                    /* SETTLE */
#endif
       fi
    od
  } unless { atomic { killed -> killed = false; begun = true } }
  od
}

proctype Chaos() {
#ifdef CRASH
  do
  :: killed = true; !killed
  :: break
  od;
#endif
#ifdef RESET
  resetting = true;
#endif
  skip
}

init { atomic { run Pmac(); run Host(); run Chaos() } }
