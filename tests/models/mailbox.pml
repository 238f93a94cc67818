/* The VME mailbox port: mailbox 0, whose writing by the host is the trigger, mailbox 1, by which the host lets PMAC send,
 * mailbox 2 for all the others, and the two interrupts: group taken, reply lies.
 *
 * Pmac mirrors src/sim/mailbox.rs, Host src/function/mailbox.rs. Every access to a register is one step. The mailboxes
 * are the same for both directions. A command is one group, its reply two: a line, then the acknowledgement.
 *
 * What holds: PMAC takes each group whole and once; a group of a reply is read whole and given to the command it belongs to.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * ONE_PIECE   PMAC fills the mailboxes in one step, and not while a group lies there untaken. Without it FAILS: the host's
 *             <CTRL-X>, at a deadline, meets PMAC filling: PMAC overwrites it, and takes its own character for a command.
 *             No host can prevent that, but by a deadline so late that no reply is on its way.
 * MESSAGES    programs on the board send messages, which look like lines of a reply
 * ALWAYS      the host lets PMAC send while it awaits nothing too (EnableReplies::Always, the manual's way), so that
 *             messages come. FAILS with MESSAGES: PMAC puts a message into the mailboxes while the host writes a group
 *             there: what lies there then is of both, for whoever reads it. A board whose programs send must be used
 *             with EnableReplies::WithCommand, where this holds, but a message that comes while a reply is awaited is
 *             taken for a line of it (it has no mark).
 * LOSE        interrupts are lost. Nothing wrong is told, as nothing is done without one; a deadline ends the wait.
 * CRASH       the host is killed anywhere, any number of times, and started again.
 */
#define COMMANDS 4
#define CANCEL 24
#define LINE 8
#define ACK 16
#define MESSAGE 32

byte box[3];                                          /* 0, and 2 for the others; 1 is not used as a store */
bool trigger = false;                                 /* the host has written mailbox 0 */
bool may_fill = false;                                 /* the host has written mailbox 1 */
bool group_taken = false, reply_lies = false;         /* the interrupts, as the host was told of them */

byte queue[3], queued = 0;
byte done[COMMANDS];
byte passes = 0;                                      /* since the host's silence began; saturates at 2 */
bool killed = false;

inline tell(what) {
#ifdef LOSE
  if :: what = true :: skip fi
#else
  what = true
#endif
}

proctype Pmac() {
  byte first;
  do
  :: if                                               /* one background pass */
     :: trigger ->
        first = box[0];
        atomic {
          trigger = false;
          if
          :: first == CANCEL -> queued = 0; queue[0] = 0; queue[1] = 0; queue[2] = 0
          :: else -> assert(first < COMMANDS && first == box[2]); done[first]++; assert(done[first] == 1);
             if :: queued < 2 -> queue[queued] = LINE + first; queue[queued + 1] = ACK + first; queued = queued + 2 :: else fi
          fi;
          first = 0
        };
        tell(group_taken)
     :: else
     fi;
#ifdef MESSAGES
     if
     :: queued == 0 -> queue[0] = MESSAGE; queued = 1
     :: true
     fi;
#endif
     if
#ifdef ONE_PIECE
     :: atomic { may_fill && queued > 0 && !trigger  -> may_fill = false; box[0] = queue[0]; box[2] = queue[0];
        queue[0] = queue[1]; queue[1] = queue[2]; queue[2] = 0; queued--; tell(reply_lies) }
#else
     :: may_fill && queued > 0 ->
        may_fill = false;
        box[0] = queue[0];
        box[2] = queue[0];
        atomic { queue[0] = queue[1]; queue[1] = queue[2]; queue[2] = 0; queued--; tell(reply_lies) }
#endif
     :: else
     fi;
     atomic { if :: passes < 2 -> passes++ :: else fi }
  od
}

#define IDLE 0
#define SENDING 1
#define REPLYING 2
#define SETTLING 3

proctype Host() {
  byte state, job, a, b;
  bool may;                                           /* mailbox 1 was written since the last group came */
  bool quiet;
  do
  :: {
    atomic { state = SETTLING; passes = 0; group_taken = false; reply_lies = false; may = true };
    atomic { may_fill = true; passes = 0 };           /* start */
    do
    :: atomic { quiet = (passes == 2) && !reply_lies };
       if
       :: atomic { reply_lies -> reply_lies = false; may = false; passes = 0; if :: state == SENDING -> state = REPLYING :: else fi };
          a = box[0];
          b = box[2];
          atomic {
            if
            :: state == REPLYING && a < MESSAGE -> assert(a == b && a % LINE == job && done[job] == 1);
               if :: a >= ACK -> state = IDLE :: else fi
            :: else
            fi;
            a = 0; b = 0
          };
          if
#ifdef ALWAYS
          :: atomic { true -> may_fill = true; may = true; passes = 0 }
#else
          :: atomic { state != IDLE -> may_fill = true; may = true; passes = 0 }
          :: state == IDLE
#endif
          fi
       :: atomic { group_taken && !reply_lies -> group_taken = false; if :: state == SENDING -> state = REPLYING :: else fi };
          if
          :: atomic { state == REPLYING && !may -> may_fill = true; may = true; passes = 0 }
          :: else
          fi
       :: atomic { !reply_lies && state == IDLE && !group_taken -> job = (job + 1) % COMMANDS; done[job] = 0 };
          box[2] = job;                               /* begin */
          atomic { group_taken = false; box[0] = job; trigger = true; state = SENDING }
       :: atomic { state == SENDING || state == REPLYING -> skip };       /* the deadline: give_up */
          atomic { box[0] = CANCEL; trigger = true; group_taken = false };
          atomic { reply_lies = false; may_fill = true; may = true; state = SETTLING; passes = 0 }
       :: atomic { state == SETTLING && quiet -> state = IDLE }
       fi
    od
  } unless { atomic { killed -> killed = false; a = 0; b = 0; quiet = false } }
  od
}

proctype Chaos() {
#ifdef CRASH
  do
  :: killed = true; !killed
  :: break
  od;
#endif
  skip
}

init { atomic { run Pmac(); run Host(); run Chaos() } }
