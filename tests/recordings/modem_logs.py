"""Six logs of one exchange of messages, each as another modem or another tool writes it."""

from __future__ import annotations

from typing import Any, NamedTuple


class ModemLog(NamedTuple):
    """A log: its text, the keys of its format, and whether its clock counts from 1970 on."""

    text: str
    keys: dict[str, Any]
    since_1970: bool = True


PLAIN = """\
sent,delivered
1714557600,1714557601.002
1714557602,1714557602.998
1714557604,
1714557606,1714557607.25
1714557608,
1714557610,1714557611.002
1714557612,1714557613.107
1714557614,1714557615.001
"""
"""The exchange as this project writes it: eight messages, two of them lost."""

SEMICOLONS = """\
# acoustic modem, instant messages
timestamp_tx;timestamp_rx;integrity;rssi
1714557600.000;1714557601.002;148;-62
1714557602.000;1714557602.998;151;-61
1714557604.000;-;;
1714557606.000;1714557607.250;139;-66
1714557608.000;-;;
1714557610.000;1714557611.002;150;-62
1714557612.000;1714557613.107;141;-64
1714557614.000;1714557615.001;149;-62
"""

UTC = """\
time_sent,time_arrival,src,dest,frame
2024-05-01T10:00:00Z,2024-05-01T10:00:01.002Z,1,2,0
2024-05-01T10:00:02Z,2024-05-01T10:00:02.998Z,1,2,1
2024-05-01T10:00:04Z,,1,2,2
2024-05-01T10:00:06Z,2024-05-01T10:00:07.250Z,1,2,3
2024-05-01T10:00:08Z,,1,2,4
2024-05-01T10:00:10Z,2024-05-01T10:00:11.002Z,1,2,5
2024-05-01T10:00:12Z,2024-05-01T10:00:13.107Z,1,2,6
2024-05-01T10:00:14Z,2024-05-01T10:00:15.001Z,1,2,7
"""

TWO_ZONES = """\
Tx Timestamp,Rx Timestamp,SNR dB
2024-05-01 12:00:00+02:00,2024-05-01 11:00:01.002000000+01:00,11.2
2024-05-01 12:00:02+02:00,2024-05-01 11:00:02.998000000+01:00,12.0
2024-05-01 12:00:04+02:00,null,
2024-05-01 12:00:06+02:00,2024-05-01 11:00:07.250000000+01:00,9.8
2024-05-01 12:00:08+02:00,null,
2024-05-01 12:00:10+02:00,2024-05-01 11:00:11.002000000+01:00,11.4
2024-05-01 12:00:12+02:00,2024-05-01 11:00:13.107000000+01:00,10.1
2024-05-01 12:00:14+02:00,2024-05-01 11:00:15.001000000+01:00,11.3
"""

MILLISECONDS = """\
seq,sendTime,recvTime
17,1714557600000,1714557601002.0
18,1714557602000,1714557602998.0
19,1714557604000,NaN
20,1714557606000,1714557607250.0
21,1714557608000,NaN
22,1714557610000,1714557611002.0
23,1714557612000,1714557613107.0
24,1714557614000,1714557615001.0
"""

DECIMAL_COMMAS = """\
t_send [s]\tt_recv [s]\tAbstand
0,000\t1,002\t1503,0
2,000\t2,998\t1497,0
4,000\t-1\t
6,000\t7,250\t1875,0
8,000\t-1\t
10,000\t11,002\t1503,0
12,000\t13,107\t1660,5
14,000\t15,001\t1501,5
"""

NO_ROW_WHERE_LOST = """\
 id    tx_ms  latency_ms  crc
  1        0        1002   ok
  2     2000         998   ok
  4     6000        1250   ok
  6    10000        1002   ok
  7    12000        1107   ok
  8    14000        1001   ok
"""

MODEM_LOGS = {
    "semicolons, a dash": ModemLog(SEMICOLONS, {}),
    "ISO times in UTC": ModemLog(UTC, {}),
    "ISO times of two zones, null": ModemLog(TWO_ZONES, {}),
    "milliseconds since 1970, NaN": ModemLog(MILLISECONDS, {"unit": "ms"}),
    "tabs, decimal commas, -1": ModemLog(DECIMAL_COMMAS, {}, since_1970=False),
    "a table of latencies": ModemLog(
        NO_ROW_WHERE_LOST, {"delay": "latency_ms", "sequence": "id"}, since_1970=False
    ),
}
