//! `glasswing demo`: a synthetic alpine valley and a flight through it, sent as CANaerospace frames through the real
//! decoder and state: over `vcan0` where the machine has it, else over a bus within the process.

use crate::app::board::{Airspeeds, Board};
use crate::app::cockpit::{self, Cockpit};
use crate::app::contact;
use crate::app::error::{Failure, Kind};
use crate::app::fly::{self, Every, Plan};
use crate::app::frames::FrameWriter;
use crate::app::health::Pulse;
use crate::app::intake::Intake;
use crate::app::out::say;
use crate::app::picture::{Effort, Size, write_png};
use crate::app::run::{seconds, stop_on_signals, with_sources, write_json};
use crate::app::sources;
use crate::bench::flight::{Day, Flight, Sensors};
use crate::bus::{Endpoint, SourceHandle, can, loopback};
use crate::display::BaroSetting;
use crate::geo::Geodetic;
use crate::proto::Protocol;
use crate::screen::{self, Screen, Wishes};
use crate::signal::{Frame, SourceId, Wire};
use crate::state::{FlightState, Fusion};
use crate::terrain::pack::Pack;
use crate::terrain::synth;
use crate::time::Monotonic;
use crate::units::{Hectopascals, Knots, Metres};
use glam::DVec2;
use serde_json::json;
use std::f64::consts::TAU;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// The CAN interface that the demo uses if it is there and up.
const VCAN: &str = "vcan0";
/// CAN frames on their way within the process: the demo sends about 700 a second, this is a second and a half.
const LOOPBACK_FRAMES: usize = 1024;
/// How often the sensors look at the clock. Their fastest message comes every 20 ms.
const SENSORS_PERIOD: Duration = Duration::from_millis(2);
/// Pictures on the contact sheet.
const SHEET: (u32, u32) = (3, 4);
/// Height of the flight above the valley floor.
const ABOVE_FLOOR_M: f64 = 450.0;
/// How far to each side of the valley's middle the flight weaves. Within 1.2 km the ground is level.
const WEAVE_M: f64 = 350.0;
/// Length of a weave.
const WEAVE_LENGTH_M: f64 = 3600.0;
/// How far before the airfield the flight begins.
const RUN_IN_M: f64 = 9000.0;
/// Length of a degree of latitude, near enough for a line that only has to look good.
const METRES_PER_DEGREE: f64 = 111_200.0;
/// The altimeter setting of the day.
const QNH: Hectopascals = Hectopascals(1018.0);
/// A still that has not all its terrain by now never will, not even on an emulated processor that draws by software.
const SETTLE_MAX: Duration = Duration::from_secs(120);

/// Flies a synthetic alpine valley, on the screen if one is free, else into picture files
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Writes into DIR: demo.pack (the terrain) and summary.json; without a screen also frames with frames.csv and \
    contact-sheet.png.\n\nExample:\n  glasswing demo --out /tmp/flight --seconds 20"
)]
pub struct DemoArgs {
    /// Where to write
    #[arg(long, value_name = "DIR", default_value = "glasswing-demo")]
    out: PathBuf,
    /// How long to fly
    #[arg(long, value_name = "S", default_value = "30", value_parser = seconds)]
    seconds: Duration,
    /// Size of the picture without a screen
    #[arg(long, value_name = "WxH", default_value = "1024x600")]
    size: Size,
    /// What to draw on
    #[arg(long, value_enum, default_value_t = Where::Auto)]
    screen: Where,
    /// Samples per pixel; none is quicker, most of all on a processor that draws by itself
    #[arg(long, value_enum, default_value_t = Antialiasing::Four)]
    antialiasing: Antialiasing,
    /// The demo's terrain as `glasswing terrain synth` made it before, instead of making it again
    #[arg(long, value_name = "PACK")]
    pack: Option<PathBuf>,
    /// Only draw the picture of this second of the flight, the same every time: to still.png, or held on the screen
    #[arg(long, value_name = "S", value_parser = seconds)]
    still: Option<Duration>,
}

/// What the demo draws on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Where {
    /// The screen if there is one and it is free, else EGL without one
    Auto,
    /// The screen
    Kms,
    /// EGL without a screen
    Surfaceless,
    /// `OSMesa`
    Osmesa,
}

/// Samples per pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Antialiasing {
    /// One
    None,
    /// Four
    #[value(name = "4x")]
    Four,
}

/// Runs the command.
///
/// # Errors
/// The first thing that refuses: the folder, the screen, the GPU, the bus.
pub fn run(args: DemoArgs) -> Result<(), Vec<Failure>> {
    let started = Monotonic::read();
    let board = board(&args)?;
    demo(&args, &board, started).map_err(|f| vec![f])
}

/// The base board with the demo aircraft's airspeeds.
fn board(args: &DemoArgs) -> Result<Board, Vec<Failure>> {
    let mut board = Board::base()?;
    board.screen.size = args.size;
    board.screen.samples = match args.antialiasing {
        Antialiasing::None => 0,
        Antialiasing::Four => 4,
    };
    board.screen.kind = match args.screen {
        Where::Auto => screen::Kind::Auto(Wishes::default()),
        Where::Kms => screen::Kind::Kms(Wishes::default()),
        Where::Surfaceless => screen::Kind::Surfaceless,
        Where::Osmesa => screen::Kind::OsMesa,
    };
    // An ultralight of the 600 kg class; round numbers of no particular type.
    board.airspeeds = Airspeeds {
        vs0: Some(Knots(38.0)),
        vs1: Some(Knots(45.0)),
        vfe: Some(Knots(75.0)),
        vno: Some(Knots(115.0)),
        vne: Some(Knots(140.0)),
    };
    Ok(board)
}

fn demo(args: &DemoArgs, board: &Board, started: Monotonic) -> Result<(), Failure> {
    let stop = stop_on_signals()?;
    let pack = terrain(args)?;
    let flight = Arc::new(flight(&pack)?);
    let mut screen = cockpit::open_screen(board)?;
    let mut cockpit = Cockpit::new(screen.as_ref(), board, Some(pack))?;
    if let Some(setting) = BaroSetting::new(QNH) {
        cockpit.ui.baro = setting;
    }
    if let Some(t) = args.still {
        return still(args, screen.as_mut(), &mut cockpit, &flight, t, &stop);
    }
    let bus = Bus::open(&flight)?;
    say!(
        "flying {} s: sensors on the bus {}, picture on {}",
        args.seconds.as_secs_f64(),
        bus.place,
        screen.describe()
    );
    let plan = Plan {
        stop,
        duration: Some(args.seconds),
        headless_period: Duration::from_secs(1) / board.screen.rate_hz,
        frames: frame_writer(args, screen.as_ref(), started)?,
        pulse: Arc::new(Pulse::default()),
        started,
    };
    let Bus {
        source,
        place,
        sensors,
    } = bus;
    let SourceHandle {
        signals, thread, ..
    } = source;
    let mut intake = Intake::new([signals], Fusion::new(&[SourceId(0)]));
    let headless = screen.is_headless();
    let figures = fly::fly(
        screen.as_mut(),
        &mut cockpit,
        plan,
        |_| (),
        |now| intake.step(now),
    )?;
    drop(sensors);
    let mut summary = with_sources(figures.to_json(), &[thread]);
    let (width_px, height_px) = screen.size_px();
    summary["size_px"] = json!(
        Size {
            width_px,
            height_px
        }
        .to_string()
    );
    summary["screen"] = json!(screen.describe());
    summary["renderer"] = json!(cockpit.describe());
    summary["bus"] = json!(place);
    if headless {
        let sheet = args.out.join("contact-sheet.png");
        contact::write(&args.out, SHEET, &sheet)?;
        summary["contact_sheet"] = json!(sheet.display().to_string());
    }
    write_json(&args.out.join("summary.json"), &summary)?;
    say!(
        "{} frames; what was drawn and how long it took: {}",
        figures.frames(),
        args.out.display()
    );
    Ok(())
}

/// The synthetic valley: the pack that was given, else one made in the folder.
fn terrain(args: &DemoArgs) -> Result<Pack, Failure> {
    let folder = &args.out;
    std::fs::create_dir_all(folder).map_err(|e| {
        let todo = "give a folder that can be written to with --out";
        Failure::new(Kind::Input, folder.display(), "cannot be made", todo).caused_by(e)
    })?;
    if let Some(pack) = &args.pack {
        return cockpit::open_pack(pack);
    }
    let file = folder.join("demo.pack");
    let jobs = std::thread::available_parallelism().map_or(1, usize::from);
    synth::bake(synth::SEED, &file, jobs, &mut |_, _| ()).map_err(|e| {
        Failure::new(
            Kind::Other,
            file.display(),
            "cannot be written",
            "make room on the disk",
        )
        .caused_by(e)
    })?;
    cockpit::open_pack(&file)
}

/// The flight: along the valley towards the airfield, in turns from one side to the other.
fn flight(pack: &Pack) -> Result<Flight, Failure> {
    let valley = synth::valley(synth::SEED);
    let line = weave(&valley);
    let undulation = |p: &Geodetic| pack.geoid().undulation_m(p.latitude, p.longitude);
    // The valley lies within its own pack's geoid.
    let undulation = line.first().and_then(undulation).unwrap_or(0.0);
    let line: Vec<Geodetic> = line
        .iter()
        .map(|p| Geodetic {
            height_ellipsoid: p.height_ellipsoid + Metres(undulation),
            ..*p
        })
        .collect();
    let day = Day {
        qnh: QNH,
        undulation: Metres(undulation),
        wind_mps: DVec2::ZERO,
        warmer_k: 0.0,
    };
    Flight::along(&line, day).map_err(|e| {
        Failure::new(
            Kind::Other,
            "the demo's flight",
            "cannot be flown",
            "report this",
        )
        .caused_by(e)
    })
}

/// A line along the valley, [`WEAVE_M`] to each side of its middle every [`WEAVE_LENGTH_M`], from [`RUN_IN_M`] before the
/// airfield to the valley's end. Heights are above the geoid.
fn weave(valley: &synth::Valley) -> Vec<Geodetic> {
    let points = &valley.centreline;
    let field = &valley.airfield;
    let from_field = |p: &synth::CentrePoint| {
        (p.latitude_deg - field.latitude_deg).hypot(p.longitude_deg - field.longitude_deg)
    };
    let nearest = points
        .iter()
        .min_by(|a, b| from_field(a).total_cmp(&from_field(b)));
    let start_m = nearest.map_or(0.0, |p| p.along_m) - RUN_IN_M;
    let pairs = points.iter().zip(points.iter().skip(1));
    pairs
        .filter(|(p, _)| p.along_m >= start_m)
        .map(|(p, next)| {
            let north = next.latitude_deg - p.latitude_deg;
            let narrow = p.latitude_deg.to_radians().cos();
            let east = (next.longitude_deg - p.longitude_deg) * narrow;
            let aside_deg = WEAVE_M * ((p.along_m - start_m) / WEAVE_LENGTH_M * TAU).sin()
                / METRES_PER_DEGREE
                / north.hypot(east);
            Geodetic::from_degrees(
                p.latitude_deg - east * aside_deg,
                p.longitude_deg + north * aside_deg / narrow,
                p.floor_m + ABOVE_FLOOR_M,
            )
        })
        .collect()
}

fn frame_writer(
    args: &DemoArgs,
    screen: &dyn Screen,
    started: Monotonic,
) -> Result<Option<(FrameWriter, Every)>, Failure> {
    if !screen.is_headless() {
        return Ok(None);
    }
    // Twice as many pictures as the sheet has places, so that it can leave out the first ones.
    let every = args.seconds / (2 * SHEET.0 * SHEET.1);
    let writer = FrameWriter::start(&args.out, args.size, started)?;
    Ok(Some((writer, Every::Time(every))))
}

/// The bus of the demo, with the sensors on one end and the decoder on the other.
struct Bus {
    source: SourceHandle,
    place: &'static str,
    sensors: SensorsThread,
}

impl Bus {
    fn open(flight: &Arc<Flight>) -> Result<Self, Failure> {
        let (name, id, protocol) = ("demo", SourceId(0), Protocol::CanAerospace);
        if can::exists(VCAN)
            && let Ok(sender) = can::Sender::open(VCAN)
        {
            let source = sources::listen_can(name, id, protocol, VCAN)?;
            // A frame that the interface refuses is one that the display will miss, and say so.
            let send = move |can| {
                let _ = sender.send(&can);
            };
            let sensors = SensorsThread::start(Arc::clone(flight), send)?;
            return Ok(Self {
                source,
                place: VCAN,
                sensors,
            });
        }
        let (mut sender, receiver) = loopback::bus(LOOPBACK_FRAMES);
        let source = sources::listen(name, id, protocol, Endpoint::Loopback(receiver))?;
        let send = move |can| {
            let _ = sender.send(Monotonic::read(), can);
        };
        let sensors = SensorsThread::start(Arc::clone(flight), send)?;
        Ok(Self {
            source,
            place: "in-process",
            sensors,
        })
    }
}

/// Sends the flight's frames at their times until dropped.
struct SensorsThread {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl SensorsThread {
    fn start(
        flight: Arc<Flight>,
        mut send: impl FnMut(crate::signal::CanData) + Send + 'static,
    ) -> Result<Self, Failure> {
        let stop = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&stop);
        let thread = std::thread::Builder::new()
            .name("sensors".into())
            .spawn(move || {
                let start = Monotonic::read();
                let mut sensors = Sensors::new();
                while !seen.load(Ordering::Acquire) {
                    let t = Monotonic::read().since(start).unwrap_or_default();
                    sensors.send_until(&flight, t, &mut |_, can| send(can));
                    std::thread::sleep(SENSORS_PERIOD);
                }
            })
            .map_err(Failure::no_thread)?;
        Ok(Self {
            stop,
            thread: Some(thread),
        })
    }
}

impl Drop for SensorsThread {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The state after `t` of the flight, by the real decoder, on the flight's own clock.
fn state_at(flight: &Flight, t: Duration) -> (FlightState, Monotonic) {
    let start = Monotonic::from_nanos(1_000_000_000);
    let mut decoder = Protocol::CanAerospace.decoder();
    let mut fusion = Fusion::new(&[SourceId(0)]);
    Sensors::new().send_until(flight, t, &mut |after, can| {
        let frame = Frame {
            at: start.plus(after),
            source: SourceId(0),
            wire: Wire::Can(can),
        };
        decoder.push(frame, &mut |signal| fusion.apply(&signal));
    });
    let now = start.plus(t);
    (fusion.step(now), now)
}

/// One picture, with all its terrain: to a file, or held on the screen until told to stop.
fn still(
    args: &DemoArgs,
    screen: &mut dyn Screen,
    cockpit: &mut Cockpit,
    flight: &Flight,
    t: Duration,
    stop: &AtomicBool,
) -> Result<(), Failure> {
    let (state, now) = state_at(flight, t);
    let deadline = Monotonic::read().plus(SETTLE_MAX);
    while !cockpit.stream(&state, now) {
        if Monotonic::read() > deadline {
            let why = format!("is not all there after {SETTLE_MAX:?}");
            return Err(Failure::new(
                Kind::Other,
                "the demo's terrain",
                why,
                "report this",
            ));
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    cockpit.draw(&state, now);
    if screen.is_headless() {
        let mut rgba = vec![0; args.size.rgba_bytes()];
        cockpit.read_rgba(&mut rgba);
        let file = args.out.join("still.png");
        write_png(&file, args.size, &rgba, Effort::Small, &mut Vec::new())?;
    } else {
        let end = Monotonic::read().plus(args.seconds);
        while !stop.load(Ordering::Acquire) && Monotonic::read() < end {
            cockpit.draw(&state, now);
            screen.present().map_err(|e| fly::screen_failed(&e))?;
        }
    }
    write_json(
        &args.out.join("summary.json"),
        &json!({ "still_s": t.as_secs_f64() }),
    )
}
