block {{ identifier }} "A control valve with stick-slip, fitted to the recording of {{ valve | in_string }}"
  // {{ sentence }}
  // Written by {{ tool }}. OP and position in percent; S and J in percent of OP, others of travel.
  //
  //   OP --curve--> command --dead time--> lag --> ringing --> speed limit --> air supply --> force
  //      --stick-slip--> stem --play--> position
  //
  // The element is the canonical one of Choudhury, Thornhill and Shah (2005,
  // doi:10.1016/j.conengprac.2004.05.005): a stem at rest breaks away when the force on it exceeds
  // (S + J)/2, and slides (S - J)/2 behind its force until it stops. The valve moves once every
  // sample_time, with the OP of that moment, beginning at time 0.

  input Real OP(start = {{ chain.op_start | exact }}) "The controller's output, %";
  output Real position(start = {{ values.position_start | exact }}) "The position as it is read, %";
  output Real stem(start = {{ values.position_start | exact }}) "Where the stem is, %";

{% for one in parameters %}
  parameter Real {{ one.name }}{% if one.low is not none %}(min = {{ one.low | exact }}){% endif %} = {{ one.value | exact }} "{{ one.meaning }}, {{ one.unit }}";
{% endfor %}
{% if curve_op %}
  parameter Real curve_op[{{ curve_op | length }}] = { {{- curve_op | map("exact") | join(", ") -}} } "Points of the curve: OP, %";
  parameter Real curve_travel[{{ curve_op | length }}] = { {{- curve_travel | map("exact") | join(", ") -}} } "Points of the curve: travel, %";
{% endif %}

protected
  constant Boolean one_actuator = {{ "true" if chain.one_actuator else "false" }} "Lag and speed limit are one device, and the stem slides while its command moves";
  constant Real unit_s = {{ chain.unit_s | exact }} "Seconds in a unit of the clock on which the valve was fitted";
  constant Real rounding = 1e-9 "Percent; a smaller step of the force is a held command";
  parameter Integer delay = integer(dead_time / sample_time) "Whole samples of the dead time";
  parameter Real late = dead_time / sample_time - delay "The rest of them";
  constant Real pi = 3.141592653589793;
  parameter Integer ring_parts = max(10, integer(ceil(sample_time / unit_s / 0.1 - 1e-9))) "Of a sample, in which ringing is counted";
  discrete Real waiting[delay + 2] "Commands that are on their way, the newest first, %";
  discrete Real command, lagged, rung, ring_speed, limited, step, air, before_air, force;
  discrete Real x "The stem, %";
  discrete Real left "Of the force on the stem, after it has moved";
  discrete Real z "Where its reading stands, %";
  discrete Real anchor[3] "Of the elements of the spring's inner friction, which slip at their reach, %";
  discrete Real way "1 rising, -1 falling";
  discrete Real speed "Of a stem with inertia, %/s";
  discrete Real rested "Samples";
  discrete Real age "Samples since the start";
  discrete Real course "How much of record_time is over, 0 to 1";
  discrete Real reading_at_50 "What is read where the stem is at 50 % of travel";
  discrete Boolean moving;
  Real error, part, f, level, jump, up, down, rise, sliding, gap, share, place, off, pushed, least, stiffness, reach, slides;
  Boolean begun(start = false, fixed = true);

algorithm
  when sample(0, sample_time) then
{% if curve_op %}
    command := if OP <= curve_op[1] then curve_travel[1] else curve_travel[{{ curve_op | length }}];
    for i in 1:{{ curve_op | length - 1 }} loop
      if OP >= curve_op[i] and OP < curve_op[i + 1] then
        command := (curve_travel[i + 1] - curve_travel[i]) / (curve_op[i + 1] - curve_op[i]) * (OP - curve_op[i]) + curve_travel[i];
      end if;
    end for;
{% else %}
    command := OP;
{% endif %}

    age := if begun then age + 1 else 0;
    course := min(age * sample_time / record_time, 1);
    reading_at_50 := 50 + reading_zero + reading_drift * (course - 0.5) + reading_wave_1 * sin(pi * course) + reading_wave_2 * sin(2 * pi * course) + reading_wave_3 * sin(3 * pi * course);

    if not begun then
      // At the first sample all is at rest, the stem at position_start or as near as friction lets it.
      begun := true;
      waiting := fill(command, delay + 2);
      lagged := command;
      rung := command;
      limited := command;
      before_air := command;
      ring_speed := 0;
      step := 0;
      air := 0;
      speed := 0;
      rested := 0;
      way := 1;
      moving := false;
      z := (position_start - reading_at_50) / reading_gain + 50;
      level := abs(0.5 * (S + J) * abs(travel_per_op)) + 0.5 * play;
      x := z;
    else
      // Dead time, on the line between two samples.
      for i in 1:delay + 1 loop
        waiting[delay + 3 - i] := waiting[delay + 2 - i];
      end for;
      waiting[1] := command;
      command := waiting[delay + 1] + late * (waiting[delay + 2] - waiting[delay + 1]);
      level := -1;
    end if;

    // Friction and force at this place of the stem, from a table with a step of 1 %.
    place := min(max(x + 20, 0), 139.999999);
    off := 0;
    pushed := 0;
    stiffness := 1;
    for i in 0:1 loop
      share := if i == 0 then 1 - (place - floor(place)) else place - floor(place);
      part := floor(place) + i - 20;
      gap := (part - tight_place) / tight_width;
      off := off + (if abs(gap) < 6 then share * tight_friction * exp(-gap * gap) else 0);
      f := flow_force * (4 * part / 100 * (1 - part / 100) - 1);
      part := min(max(part / 50 - 1, -1), 1);
      f := f + load_linear * part + load_square * part ^ 2 + load_cube * part ^ 3;
      pushed := pushed + share * f;
      stiffness := stiffness + (if i == 0 then -f else f);
    end for;
    // A force that rises over the travel closes the gap on the way, as a stiffer spring would.
    stiffness := max(stiffness, 0.5);

    if level >= 0 then
      level := level + abs(off) + abs(pushed) + spring_hysteresis;
      x := min(max(z, command - level), command + level);
      z := x;
      left := command - x - pushed;
      reach := spring_way / 4;
      for i in 1:3 loop
        anchor[i] := x - (command - x) / max(level, rounding) * reach;
        reach := 2 * reach;
      end for;
    else
      if one_actuator then
        error := command - limited;
        share := if error > 0 then lag_rising else lag_falling;
        share := if share > 1e-3 * unit_s then 1 - exp(-sample_time / share) else 1;
        step := min(max(error * share, -speed_falling * sample_time), speed_rising * sample_time);
        limited := limited + step;
      else
        error := command - lagged;
        share := if error > 0 then lag_rising else lag_falling;
        lagged := lagged + (if share > 1e-3 * unit_s then 1 - exp(-sample_time / share) else 1) * error;
        error := rung - lagged;
        if ring_frequency > 0 then
          part := sample_time / ring_parts;
          for i in 1:ring_parts loop
            ring_speed := (1 - 2 * part * ring_damping * ring_frequency) * ring_speed - part * ring_frequency ^ 2 * error;
            error := error + part * ring_speed;
          end for;
          rung := lagged + error;
        else
          rung := lagged;
        end if;
        limited := limited + min(max(rung - limited, -speed_falling * sample_time), speed_rising * sample_time);
      end if;

      share := if supply_sag > 0 then 1 else -1;
      air := max(1 - sample_time / supply_recovery, 0) * air + abs(supply_sag) / 100 * max(share * (limited - before_air), 0);
      before_air := limited;
      reach := spring_way / 4;
      for i in 1:3 loop
        anchor[i] := min(max(anchor[i], x - reach), x + reach);
        pushed := pushed + spring_hysteresis * (x - anchor[i]) / (3 * reach);
        reach := 2 * reach;
      end for;
      force := limited - share * air - pushed;

      level := 0.5 * S * abs(travel_per_op) * (1 + friction_growth * course) + off;
      jump := 0.5 * J * abs(travel_per_op) * (1 + friction_growth * course);
      up := jump * (1 + slip_asymmetry);
      down := jump * (1 - slip_asymmetry);
      rise := dwell_breakaway * log(1 + (if moving then 0 else rested) * sample_time / dwell_time);
      rested := if moving then 1 else rested + 1;

      if run_up > 0 then
        // With inertia: the force balance in four implicit steps. The motor pushes by what is left
        // of its way, up to the limit of its voltage; the load pulls back.
        part := sample_time / 4;
        least := if drag > 0 and top_speed < 1e6 then drag * top_speed else 1e30;
        for i in 1:4 loop
          share := force + pushed - x;
          f := min(max(share, -least), least) - pushed;
          if speed > 0 or f > level + up + rise or -f > level + down + rise then
            way := if speed > 0 then way else if f > level + up + rise then 1 else -1;
            gap := way * f - (level - (if way > 0 then up else down));
            speed := max((drag * run_up / part * speed + gap) / (drag * run_up / part + drag + (if abs(share) < least then part else 0)), 0);
            x := x + way * speed * part;
          end if;
        end for;
        speed := if x < stop_low or x > stop_high then 0 else speed;
        moving := speed > 0;
      else
        f := force - x;
        part := if f > 0 then 1 else -1;
        gap := abs(f) - 0.5 * (S - J) * abs(travel_per_op);
        if spring_hysteresis > 0 and gap > 0 then
          // As stiff as spring and inner friction are over the way that closes the gap.
          slides := 0;
          for i in 1:4 loop
            place := 1;
            least := 0;
            reach := spring_way / 4;
            for j in 1:3 loop
              share := reach - part * (x - anchor[j]);
              place := place + (if share > slides then spring_hysteresis / (3 * reach) else 0);
              least := least + (if share > slides then 0 else spring_hysteresis / (3 * reach) * max(share, 0));
              reach := 2 * reach;
            end for;
            slides := (gap - least) / place;
          end for;
          stiffness := max(stiffness + gap / slides - 1, 0.5);
        end if;
        share := (if drag > 1e-3 * unit_s then 1 - exp(-sample_time * stiffness / drag) else 1) / stiffness;
        least := if restick_speed < 0 then -rounding else max(max(restick_speed, if drag > 1e-3 * unit_s then 0.01 / unit_s else 0) * sample_time / share, rounding);
        sliding := level - (if way > 0 then up else down);
        moving := moving and (if one_actuator then way * step > restick_speed * sample_time else way * f - sliding > least);
        if not moving and (f > level + up + rise or -f > level + down + rise) then
          moving := true;
          way := if f > level + up + rise then 1 else -1;
          sliding := level - (if way > 0 then up else down);
        end if;
        if not moving then
          // The packing gives to the change of the force before it lets go.
          part := if f > left then 1 else -1;
          place := max(level + (if part > 0 then up else down) + rise, 1e-3);
          share := part * f / place;
          gap := if share < 0.98 then -log(1 - min(share, 0.98)) else -log(0.02) + (share - 0.98) / 0.02;
          reach := part * left / place;
          gap := gap - (if reach < 0.98 then -log(1 - min(reach, 0.98)) else -log(0.02) + (reach - 0.98) / 0.02);
          x := x + creep * sample_time + part * gives * place * gap / (1 + gives / (1 - min(share, 0.98)));
        elseif one_actuator then
          x := force - way * sliding;
        else
          x := x + share * way * max(way * f - sliding, 0);
        end if;
        left := force - x;
      end if;
      x := min(max(x, stop_low), stop_high);
      z := min(max(z, x - 0.5 * play), x + 0.5 * play);
    end if;

    stem := x;
    position := reading_gain * (z - 50) + reading_at_50;
  end when;
end {{ identifier }};
